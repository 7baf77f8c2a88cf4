"""Limits with other bounds than a scenario's."""

import copy
from dataclasses import replace

import numpy as np

from uvms_drake.control.limits import Limit
from uvms_drake.control.limits.inputs import Forces
from uvms_drake.control.limits.pose import Joints
from uvms_drake.control.limits.static_force import StaticForce
from uvms_drake.control.ocp.ocp import Ocp


def bounded(ocp: Ocp, **bounds: object) -> dict[str, Limit]:
    """Returns the limits of a problem with other bounds, less nothing; None takes one away."""
    limits = dict(ocp.limits)
    q_lower, q_upper = (bounds.pop(key, bound) for key, bound in (
        ("q_lower", limits["q"].lower), ("q_upper", limits["q"].upper)))
    limits["q"] = Joints(np.asarray(q_lower), np.asarray(q_upper))
    for name, bound in bounds.items():
        if bound is None:
            limits.pop(name, None)
        elif name in limits:
            limits[name] = replace(limits[name], bound=bound)
        else:
            limits[name] = {"tau": lambda bound: Forces(bound), "static_force": lambda bound:
                            StaticForce(bound, ocp.model.surface)}[name](bound)
    return limits


def with_limits(ocp: Ocp, **bounds: object) -> Ocp:
    """Returns a problem with such limits."""
    other = copy.copy(ocp)
    other.limits = bounded(ocp, **bounds)
    return other
