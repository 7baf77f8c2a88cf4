"""Default gains of the baselines on a robot, read from a file with their sources."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from uvms_drake.baselines.admittance import AdmittanceGains
from uvms_drake.baselines.approach import ApproachGains
from uvms_drake.baselines.impedance import ImpedanceGains
from uvms_drake.baselines.prescribed_performance import PerformanceGains
from uvms_drake.baselines.sliding_mode import SlidingGains
from uvms_drake.baselines.vehicle_hold import HoldGains
from uvms_drake.common.errors import require
from uvms_drake.common.schema import load_typed, read_yaml

FOLDER = Path(__file__).parent


@dataclass
class ObserverGains:
    """Rates λ of the disturbance observer of a nominal MPC."""

    vehicle: float = 0.8
    """That of the vehicle's pose [1/s]."""
    tip: float = 1.3
    """That of the tip's task [1/s]."""


@dataclass
class RobotGains:
    """Gains of every law on one robot."""

    largest: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Largest commanded |τᵢ| (6+n,) [N, N m]; zero on an axis that nothing drives."""
    approach: ApproachGains = field(default_factory=ApproachGains)
    hold: HoldGains = field(default_factory=HoldGains)
    impedance: ImpedanceGains = field(default_factory=ImpedanceGains)
    admittance: AdmittanceGains = field(default_factory=AdmittanceGains)
    decoupled: SlidingGains = field(default_factory=SlidingGains)
    coupled: SlidingGains = field(default_factory=SlidingGains)
    performance: PerformanceGains = field(default_factory=PerformanceGains)
    offset_free: ObserverGains = field(default_factory=ObserverGains)


def robots_with_gains() -> list[str]:
    """Returns the names of the robots with a file of gains."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def read_gains(robot: str) -> RobotGains:
    """Returns the gains of a robot by its name."""
    require(robot in robots_with_gains(), "robot", robot,
            f"one with gains of the baselines: {', '.join(robots_with_gains())}")
    return load_typed(RobotGains, read_yaml(FOLDER / f"{robot}.yaml"))
