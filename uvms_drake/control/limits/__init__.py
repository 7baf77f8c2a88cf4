"""Limits, one kind a file, and their tightening by the tube."""

from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.limits.radii import HoldRadii, TubeRadii, resolved_radii
from uvms_drake.control.limits.settings import (
    Limits,
    check_limits,
    joint_limits,
    make_limits,
    tighten,
)

__all__ = ["HoldRadii", "Limit", "Limits", "TubeRadii", "check_limits", "joint_limits",
           "make_limits", "resolved_radii", "tighten"]
