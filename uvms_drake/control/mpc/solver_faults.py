"""Faults of the MPC's solver, after which the last plan is continued, as the proofs allow."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

import numpy as np
from pydrake.systems.framework import BasicVector, Context

from uvms_drake.common.constraints import Fraction, NotNegative, Positive
from uvms_drake.common.errors import require
from uvms_drake.common.wiring import WiredSystem
from uvms_drake.control.mpc.planner import DROPPED, FAILED, SOLVED, TIMED_OUT
from uvms_drake.model.signals.fault import Fault

PRECEDENCE = (DROPPED, FAILED, TIMED_OUT)
"""Statuses by rank: of two faults at the same instant the earlier one here counts."""
SAMPLE_TOLERANCE = 1e-6
"""Fraction of a period by which rounding may move a sampling instant."""


@dataclass
class SolverFault(Fault):
    """Fault at random sampling instants of the MPC."""

    place = "solver"
    status: ClassVar[int]
    """Status of a sample with the fault."""

    probability: Annotated[float, Fraction] = 1.0
    """Probability of the fault at a sampling instant in its time."""
    start: Annotated[float, NotNegative] = 0.0
    """First instant [s]; the first plan of a run is exempt."""
    duration: Annotated[float, Positive] | None = None
    """Duration [s]; unlimited if it is left out."""

    def assumption(self) -> None:
        """Returns None: the last plan is continued, as the proofs allow."""


@dataclass
class SolverFailure(SolverFault):
    """The solver of the MPC finds no plan."""

    status = FAILED


@dataclass
class SolverTimeout(SolverFault):
    """The plan of the MPC misses its deadline and is discarded."""

    status = TIMED_OUT


@dataclass
class DroppedPeriod(SolverFault):
    """The MPC does not run at a sampling instant."""

    status = DROPPED


def solver_fault(faults: Sequence[SolverFault], seed: int, index: int, period: float) -> int:
    """Returns the outcome of a sample of the MPC: `SOLVED`, `FAILED`, `TIMED_OUT` or `DROPPED`.

    It is a pure function of its arguments: one uniform number for each kind of fault, from a
    generator seeded with (seed, index, kind).

    Args:
        faults: At most one of a kind.
        seed: Zero or positive.
        index: Index of the sampling instant, t = index · period.
        period: Between two samples [s].
    """
    time = (index + SAMPLE_TOLERANCE) * period
    for fault in sorted(faults, key=lambda fault: PRECEDENCE.index(fault.status)):
        if fault.is_active(time):
            sequence = np.random.SeedSequence([seed, index, fault.status])
            if np.random.Generator(np.random.Philox(sequence)).random() < fault.probability:
                return fault.status
    return SOLVED


class SolverFaults(WiredSystem):
    """Schedule of the samples at which the solver of a `NominalMpc` fails, times out or is dropped.

    .. pydrake_system::

        name: SolverFaults
        output_ports:
        - fault

    - `fault` (1): `solver_fault` of the last sampling instant.

    It has no state: the output is a function of time.

    Args:
        faults: At most one of a kind.
        seed: Zero or positive.
        period: Of the samples [s].
    """

    def __init__(self, faults: Sequence[SolverFault], seed: int, period: float):
        super().__init__()
        require(seed >= 0, "seed", seed, "zero or positive")
        require(0.0 < period < np.inf, "period", period, "positive")
        self._faults, self._seed, self._period = tuple(faults), seed, period
        self.DeclareVectorOutputPort("fault", BasicVector(1), self._calc, {self.time_ticket()})

    def _calc(self, context: Context, output: BasicVector) -> None:
        index = math.floor(context.get_time() / self._period + SAMPLE_TOLERANCE)
        output.SetFromVector([solver_fault(self._faults, self._seed, index, self._period)])
