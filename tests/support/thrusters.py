"""Thrusters of made-up vehicles."""

import numpy as np

from uvms_drake.common.schema import check_values
from uvms_drake.model.description.thruster_file import (
    CurveData,
    ThrusterData,
    ThrusterKind,
    ThrusterParameters,
)

T200 = [  # Points of the maker's tables: pulse [µs], force [N]; lower voltages by their ends.
    CurveData(12.0, np.array([1100.0, 1464, 1536, 1900]), np.array([-28.6, 0.0, 0.0, 36.4])),
    CurveData(16.0, np.array([1100.0, 1200, 1300, 1400, 1440, 1464, 1472, 1528, 1536, 1560, 1600,
                              1700, 1800, 1900]),
              np.array([-39.91, -26.6, -14.1, -4.71, -1.77, -0.49, 0.0, 0.0, 0.49, 2.16, 5.88,
                        17.85, 33.5, 51.48]))]
"""Of a thruster with a dead band, weaker backwards, by two voltages."""


def t200() -> ThrusterKind:
    """Returns a kind that tests may change."""
    return ThrusterKind(lag=0.15, smallest=0.45, curves=list(T200))


def eight_thrusters(bias: float = 0.0) -> ThrusterParameters:
    """Returns four vectored and four vertical thrusters, which drive all axes."""
    thrusters = {}
    for i, (x, y) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
        thrusters[f"across{i}"] = ThrusterData(
            "t200", np.array([0.14 * x, 0.1 * y, 0.0]), np.array([1.0 * x, -1.0 * y, 0.0]))
        thrusters[f"up{i}"] = ThrusterData(
            "t200", np.array([0.12 * x, 0.22 * y, 0.06]), np.array([0.0, 0.0, -1.0]))
    out = ThrusterParameters(dead_time=0.11, voltage=16.0, bias=bias, kinds={"t200": t200()},
                             thrusters=thrusters)
    check_values(out)
    return out
