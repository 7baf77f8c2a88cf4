"""Search effort and safety factor of the certificate; part of a scenario."""

from dataclasses import dataclass, field

import numpy as np

from uvms_drake.common.errors import require, vector, within

MOST_SAMPLES = 1_000_000
"""Largest number of samples; a supremum that so many miss, more will miss too."""


@dataclass
class LinearLines:
    """Lines of |x − x_lin|, the distance of a run from its coupled linear loop."""

    tip: float = 0.001
    """Line of each coordinate of the tip [m]."""
    vehicle: float = 0.002
    """Line of each coordinate of the vehicle [m]."""
    attitude: float = 0.01
    """Line of each angle of the vehicle [rad]."""
    joints: float = 0.015
    """Line of each joint [rad, m]."""


def _none() -> np.ndarray:
    return np.zeros(0)


@dataclass
class PlanRows:
    """Largest deviations of the rows of the coupled linear loop by a plan's motion alone."""

    tip: np.ndarray = field(default_factory=_none)
    """Position of the tip along the normal and across it (3,) [m]."""
    vehicle: np.ndarray = field(default_factory=_none)
    """Position of the vehicle (3,) [m]."""
    attitude: np.ndarray = field(default_factory=_none)
    """Roll, pitch, yaw (3,) [rad]; of an axis that nothing drives from its equilibrium."""
    joints: np.ndarray = field(default_factory=_none)
    """Joints (n,) [rad, m]."""
    tip_speed: np.ndarray = field(default_factory=_none)
    """Velocity of the tip, likewise (3,) [m/s]."""
    nu1: np.ndarray = field(default_factory=_none)
    """Velocity of the vehicle (3,) [m/s]."""
    nu2: np.ndarray = field(default_factory=_none)
    """Angular velocity of the vehicle (3,) [rad/s]."""
    qdot: np.ndarray = field(default_factory=_none)
    """Rates of the joints (n,) [rad/s, m/s]."""

    def rows(self) -> np.ndarray:
        """Returns them in the order of `coupled_loop.CoupledLoop.rows`."""
        return np.concatenate([np.asarray(each, dtype=float) for each in vars(self).values()])


@dataclass
class PlanClass:
    """Class of the plans and starts that a coupled linear budget is for.

    A plan belongs to it if it alone moves no row of the linear loop farther than declared: of that
    in open water before the touch, of that on the stiffest wall of the class after it.
    """

    approach: PlanRows = field(default_factory=PlanRows)
    """Rows before the touch."""
    press: PlanRows = field(default_factory=PlanRows)
    """Rows from the touch on."""
    start: float = 0.0
    """Largest distance of an axis that nothing drives from its equilibrium at the start [rad]."""


@dataclass
class CertificateSettings:
    """Samples, seed and safety factor of the estimates."""

    constant_samples: int = 2000
    """States at which each constant is evaluated before the local searches."""
    tube_samples: int = 300
    """Nominal states from the worst of which the tube in velocities and inputs is searched for."""
    terminal_samples: int = 2000
    """States in which the terminal set is checked, for every radius tried."""
    safety_factor: float = 1.1
    """Factor of every estimated supremum."""
    seed: int = 0
    linear: LinearLines | None = None
    """Lines of |x − x_lin| that a certificate in probability counts; left out: it compares no run
    with its linear loop, which takes as long as the run."""
    plans: PlanClass | None = None
    """Class of plans and starts that the coupled linear budget counts, and that a certificate in
    probability checks in every run; left out: the budget counts no plan."""


def check_settings(settings: CertificateSettings, num_joints: int) -> None:
    """Raises `InvalidParameter` for the first setting that has no meaning."""
    for key in ("constant_samples", "tube_samples", "terminal_samples"):
        require(10 <= getattr(settings, key) <= MOST_SAMPLES, key, getattr(settings, key),
                f"from 10 to {MOST_SAMPLES}, which take hours and gigabytes")
    require(settings.safety_factor >= 1.0, "safety_factor", settings.safety_factor, "at least 1")
    require(settings.seed >= 0, "seed", settings.seed, "zero or positive")
    for key, line in ({} if settings.linear is None else vars(settings.linear)).items():
        require(0.0 < line < np.inf, f"linear.{key}", line, "positive")
    if settings.plans is None:
        return
    with within("plans"):
        require(0.0 <= settings.plans.start < np.inf, "start", settings.plans.start,
                "zero or positive")
        for stage in ("approach", "press"):
            for key, value in vars(getattr(settings.plans, stage)).items():
                with within(stage):
                    rows = vector(key, value, num_joints if key in ("joints", "qdot") else 3)
                    require(bool(np.all(rows > 0.0)), key, rows, "positive")
