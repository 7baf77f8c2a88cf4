"""First-order lag of the vehicle's wrench on all six axes: ideal thrusters with a delay."""

from dataclasses import dataclass, replace

import numpy as np

from uvms_drake.actuation.thrusters import Thrusters
from uvms_drake.common.errors import require
from uvms_drake.model.description.thruster_file import AXES
from uvms_drake.model.propulsion.thrusters import ThrusterModel, Unlimited
from uvms_drake.model.signals.command_path import CommandPath
from uvms_drake.model.uvms_model import UvmsModel


@dataclass
class LaggedWrench(Thrusters):
    """Vehicle's wrench on each axis behind a dead time and a first-order lag.

    It models the delay of thrusters alone: one on each axis, without limit or dead band. The
    robot's own thrusters are not read.
    """

    lag: float | None = 0.05
    """Time constant of the wrench [s]."""
    dead_time: float | None = 0.0
    """Dead time from a command to the first change of the wrench [s], a multiple of `period`."""
    foreseen: bool = True
    """Whether a plan's forces are commanded in advance by the delay; no proof covers it."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        for key in ("lag", "dead_time"):
            require(getattr(self, key) is not None, key, None, "a number")
        require(self.sag == 0.0, "sag", self.sag, "0: there is no voltage")
        require(not np.any(self.error), "error", self.error, "0: the wrench is exact")
        super().check()

    def assumption(self) -> str:
        """Returns the assumption that it breaks, except in `tube.actuation.lagged_wrench`."""
        return "the proofs take the vehicle's wrench for given at once"

    def command_path(self, model: UvmsModel) -> CommandPath:
        """Returns its clock, dead time and lag."""
        return replace(super().command_path(model), foreseen=self.foreseen)

    def _at(self, model: UvmsModel, sag: float) -> ThrusterModel:
        size = len(AXES)
        assert self.lag is not None and self.dead_time is not None  # or `check`
        return ThrusterModel(
            AXES, np.eye(size), (Unlimited(),) * size, np.full(size, self.lag), np.zeros(size),
            self.dead_time, 0.0, np.arange(size))
