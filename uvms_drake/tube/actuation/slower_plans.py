"""Speeds of plans that are slower than the robot by its tube, and the effect of a held command."""

from collections.abc import Mapping

import numpy as np

from uvms_drake.tube.actuation.zoh_command import ZohCommandTube
from uvms_drake.tube.law_tube import Basis
from uvms_drake.tube.loops.row_loop import RowLoop
from uvms_drake.tube.rows.disturbance_gains import ATTITUDE, JOINTS, VEHICLE, Parts
from uvms_drake.tube.rows.image import BlockBounds, least_speeds


def zoh_command_tube(basis: Basis, rows: np.ndarray, loops: tuple[RowLoop, ...],
                     table: Mapping[str, Parts], turning: float, regular: float) -> ZohCommandTube:
    """Returns the effect of a command under zero-order hold."""
    contact = basis.contact
    assert contact is not None  # or `_unknown`
    return ZohCommandTube(basis, rows, loops, table, slower_plans(basis, rows, table),
                          turning, regular, (contact.size + contact.error, contact.torque_error))


def slower_plans(basis: Basis, rows: np.ndarray, table: Mapping[str, Parts]) -> np.ndarray:
    """Returns the speed limits of plans, ‖ν̄₁‖, ‖ν̄₂‖ and ‖q̄̇‖ (3,).

    They are those of the robot less the least radii of a tube of these parts, if that is positive.
    """
    declared, sums = basis.declared, {
        name: np.sum(list(parts.values()), axis=0) for name, parts in table.items()}
    limits = np.array([declared.nu1, declared.nu2, declared.qdot])
    least = least_speeds(
        basis.model, declared, rows, block_bounds(sums, basis.model.size), basis.settings.seed)
    return np.where(least < limits, limits - least, limits)


def block_bounds(sums: Mapping[str, np.ndarray], size: int) -> list[BlockBounds]:
    """Returns the bounds for `tip_first_image`."""
    return [BlockBounds(where, *map(float, sums[name][:3])) for name, where in (
        (VEHICLE, np.arange(3)), (ATTITUDE, np.arange(3, 6)), (JOINTS, np.arange(6, size)))]
