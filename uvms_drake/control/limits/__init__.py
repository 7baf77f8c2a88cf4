"""Limits of a motion, and their tightening by the tube."""

from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.limits.pose import TipBox
from uvms_drake.control.limits.radii import HoldRadii, TubeRadii, resolved_radii
from uvms_drake.control.limits.settings import (
    Limits,
    check_limits,
    joint_limits,
    make_limits,
    tighten,
)
from uvms_drake.control.limits.speeds import TipVelocity

__all__ = ["HoldRadii", "Limit", "Limits", "TipBox", "TipVelocity", "TubeRadii", "check_limits",
           "joint_limits", "make_limits", "resolved_radii", "tighten"]
