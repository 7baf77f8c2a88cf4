"""Settings that help where a condition fails, as `--set key=value`: a first guess at their size.

Nothing here is proven. Other limits or gains change the tube, too: the next certificate may fail by
a little less, or by another condition, and its own advice goes on from there.
"""

import math

import numpy as np

from uvms_drake.control.limits.limit import Limit
from uvms_drake.control.limits.pose import Joints
from uvms_drake.control.limits.static_force import StaticForce
from uvms_drake.model.uvms_model import UvmsModel

MORE = 1.2
"""Factor on the excess, for the tube that grows with a wider limit."""
ANGLES = ("roll", "pitch", "tip_pitch")


def setting(**values: float | np.ndarray) -> str:
    """Returns the text for the command line; two underscores stand for a dot."""
    return " ".join(
        f"--set {key.replace('__', '.')}="
        + (f"{value:.6g}" if np.ndim(value) == 0 else
           "[" + ",".join(f"{each:.6g}" for each in np.asarray(value)) + "]")
        for key, value in values.items())


def wider(limit: Limit, index: int, above: bool, excess: float, model: UvmsModel) -> str:
    """Returns the setting that widens a limit on the configuration by its excess, if allowed.

    Args:
        limit: One of `limits`.
        index: Index of the value that is beyond.
        above: Whether it is beyond the upper bound.
        excess: Excess, as of `Limit.excess`.
        model: Model of the robot, whose own joint limits stay.
    """
    if isinstance(limit, StaticForce):
        force = limit.bound + MORE * excess * limit.surface.stiffness_bound
        return setting(limits__static_force=_up(force, 2))
    if limit.name in ANGLES:
        return setting(**{f"limits__{limit.name}": _up(limit.bounds()[1][0] + MORE * excess, 3)})
    if isinstance(limit, Joints):
        sign = 1.0 if above else -1.0
        bounds = np.array(limit.bounds()[above], dtype=float)
        bounds[index] = sign * _up(sign * bounds[index] + MORE * excess, 3)
        if model.q_lower[index] <= bounds[index] <= model.q_upper[index]:
            return setting(**{"limits__q_upper" if above else "limits__q_lower": bounds})
    return ""


def roomier(bound: float, reserved: float, share: float) -> str:
    """Returns the disturbance whose tube about fits: a tube is about in proportion to it.

    Larger gains make a smaller tube, too, but take more of the inputs: no advice step by step.
    Where declared unknowns ask for the bound, it is not smaller.

    Args:
        bound: `disturbance.bound`.
        reserved: `model_error.share`.
        share: Fraction of this tube that fits into the limit with the smallest margin.
    """
    if not 0.0 < share <= 1.0:
        return ""
    if reserved > 0.0:
        return "smaller declared unknowns, with the disturbance.bound that they ask for"
    return setting(disturbance__bound=float(f"{share / MORE * bound:.2g}"))


def longer(horizon: int) -> str:
    """Returns a horizon that reaches further."""
    return setting(mpc__horizon=math.ceil(1.5 * horizon))


def safer(safety_factor: float, ratio: float) -> str:
    """Returns a safety factor with which an estimate exceeds the result of a second search.

    Empty if the ratio is out of the range of a safety factor.

    Args:
        safety_factor: `certificate.safety_factor`.
        ratio: That result over the estimate.
    """
    if not 1.0 < ratio < 2.0:
        return ""
    return setting(certificate__safety_factor=_up(1.02 * ratio * safety_factor, 2))


def rounded_up(value: float, digits: int = 3) -> float:
    """Returns a positive number rounded up to significant digits."""
    step = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    return float(f"{math.ceil(value / step - 1e-9) * step:.{digits}g}")


def _up(value: float, digits: int) -> float:
    return math.ceil(value * 10**digits) / 10**digits
