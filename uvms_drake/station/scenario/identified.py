"""Logs that a robot's numbers and its unknowns were identified from, and their excitation."""

import hashlib
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from uvms_drake.common.constraints import NotNegative
from uvms_drake.common.errors import require
from uvms_drake.control.limits import Limits
from uvms_drake.model.description.robot_files import model_dir

NAMED = 3
"""Largest number of logs that a verdict names."""
QUANTITIES = {"nu1": ("‖ν₁‖", "m/s"), "nu2": ("‖ν₂‖", "rad/s"), "nu1_dot": ("‖ν̇₁‖", "m/s²"),
              "nu2_dot": ("‖ν̇₂‖", "rad/s²"), "qdot": ("‖q̇‖", "rad/s")}
"""Symbols and units of the excitation."""


@dataclass
class Identified:
    """Logs of an identification, as `uvms-drake identify` writes them beside its unknowns.

    Of the excitation each is the largest of all logs; zero is one that they did not measure.
    """

    logs: list[str] = field(default_factory=list)
    """Names of the logs, each with its SHA-256."""
    hydrodynamics: str = ""
    """SHA-256 of the identified `hydrodynamics.yaml`, which the robot has to have."""
    nu1: Annotated[float, NotNegative] = 0.0
    """Linear velocity ‖ν₁‖₂ [m/s]."""
    nu2: Annotated[float, NotNegative] = 0.0
    """Angular velocity ‖ν₂‖₂ [rad/s]."""
    nu1_dot: Annotated[float, NotNegative] = 0.0
    """Linear acceleration ‖ν̇₁‖₂ [m/s²]."""
    nu2_dot: Annotated[float, NotNegative] = 0.0
    """Angular acceleration ‖ν̇₂‖₂ [rad/s²]."""
    qdot: Annotated[float, NotNegative] = 0.0
    """Velocity of the joints ‖q̇‖₂ [rad/s]."""

    def check(self) -> None:
        """Raises `InvalidParameter` without a log."""
        require(bool(self.logs), "logs", self.logs, "the logs, at least one")

    def check_robot(self, robot: str) -> None:
        """Raises `InvalidParameter` unless a robot has the identified `hydrodynamics.yaml`."""
        found = hashlib.sha256((model_dir(robot) / "hydrodynamics.yaml").read_bytes()).hexdigest()
        require(found == self.hydrodynamics, "identified.hydrodynamics", self.hydrodynamics,
                f"that of hydrodynamics.yaml of {robot}, {found}: identify has written another one")

    def log_sentences(self) -> list[str]:
        """Returns the logs in words: a line with the first of them, and one for each other."""
        count = len(self.logs)
        more = f" and {count - NAMED} more" if count > NAMED else ""
        return [f"numbers of the water are from {count} log{'s' if count > 1 else ''}: "
                f"{', '.join(self.logs[:NAMED])}{more}", *self.logs[NAMED:]]

    def excitation(self, limits: Limits) -> str:
        """Returns the excitation beside limits in words, and where these are beyond it.

        Beside an acceleration is the norm of the commands `limits.u`.
        """
        u = np.asarray(limits.u, dtype=float)
        allowed = {"nu1_dot": float(np.linalg.norm(u[:3])),
                   "nu2_dot": float(np.linalg.norm(u[3:6]))}
        parts, beyond = [], []
        for name, (symbol, unit) in QUANTITIES.items():
            seen, limit = getattr(self, name), allowed.get(name) or getattr(limits, name)
            known = f"{seen:.3g}" if seen else "not measured"
            parts.append(f"{symbol} {known} ({limit:.3g} {unit})")
            if limit > seen:
                beyond.append(f"{symbol} by {limit - seen:.3g} {unit}" if seen else symbol)
        return (f"largest of the logs (of the limits): {', '.join(parts)}; "
                + (f"extrapolates in {', '.join(beyond)}" if beyond else "no extrapolation"))
