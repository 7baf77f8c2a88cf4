"""`signals.yaml` of a log: where each signal is, in which unit, by which clock, in which axes."""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from uvms_drake.common.constraints import Finite, OneOf
from uvms_drake.common.errors import require
from uvms_drake.identification.log import SIZES, Samples
from uvms_drake.model.frames.euler import euler_angles
from uvms_drake.sensing.conventions import BODIES, WORLDS, Conventions

UNITS = {"SI": 1.0, "deg": np.pi / 180.0, "mm": 1e-3, "g": 9.80665}
"""Size in SI units of the units that a column may be in."""
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""The same of times."""


@dataclass
class Source:
    """Columns of a table that are a signal."""

    signal: Annotated[str, OneOf("position", "armed", *SIZES)] = "attitude"
    """The signal."""
    columns: list[str] = field(default_factory=list)
    """Its columns, in the order of its components."""
    file: str = ""
    """End of the file's path, after the path that is given for the log; of a recording the message
    of ArduSub, as `ATT` or `IMU[0]`, or the topic of ROS 2."""
    time: str = "time_s"
    """Column of the times."""
    time_unit: Annotated[str, OneOf(*TIMES)] = "s"
    """Unit of the times."""
    unit: Annotated[str, OneOf(*UNITS)] = "SI"
    """Unit of the columns: SI, degrees (and degrees per second), millimetres, or standard g."""
    delay: Annotated[float, Finite] = 0.0
    """Time by which its clock is late [s]."""


@dataclass
class LogSignals(Conventions):
    """The signals of a log, in one convention."""

    signals: list[Source] = field(default_factory=list)
    """The signals."""

    def check(self) -> None:
        """Raises `InvalidParameter` for a number of columns that a signal does not have."""
        for i, each in enumerate(self.signals):
            size = {"position": 3, "armed": 1, **SIZES}[each.signal]
            if each.signal == "attitude" and self.attitude != "rpy":
                size = 4
            require(bool(each.columns) and size in (None, len(each.columns)),
                    f"signals[{i}].columns", each.columns,
                    f"{size or 'the'} names of columns of {each.signal}")

    def in_model_axes(self, signals: dict[str, Samples]) -> dict[str, Samples]:
        """Returns signals in SI units and the declared axes, in axes of the model; see `SIZES`.

        A `position` gives the depth.
        """
        C_W, C_B, out = WORLDS[self.world], BODIES[self.body], dict[str, Samples]()
        time, attitude = signals["attitude"]
        R = np.array([self.rotation(each) for each in attitude])
        out["attitude"] = time, euler_angles(R)
        for name, (at, x) in signals.items():
            if name == "joints":
                for key in ("joint_signs", "joint_offsets"):
                    require(getattr(self, key).size in (1, x.shape[1]), key, getattr(self, key),
                            f"one number, or {x.shape[1]} of them")
                out[name] = at, self.joint_signs * x + self.joint_offsets
            elif name in ("angular_velocity", "specific_force") or (
                    name == "velocity" and self.velocity == "body"):
                out[name] = at, x @ C_B.T
            elif name == "velocity":
                nearest = np.clip(np.searchsorted(time, at), 0, len(time) - 1)
                out[name] = at, np.einsum("tji,jk,tk->ti", R[nearest], C_W, x)
            elif name == "position":
                out["depth"] = at, (x @ C_W.T)[:, 2:]
            elif name == "wrench":
                out[name] = at, np.hstack([x[:, :3] @ C_B.T, x[:, 3:] @ C_B.T])
            elif name in ("depth", "force"):
                out[name] = at, x
        return out
