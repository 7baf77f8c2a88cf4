"""The certificate in short: the verdict in five numbers, and each failed condition with advice.

Everything else, a hundred lines for a reviewer, is in `table`.
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.certificate.certificate import Certificate
from uvms_drake.certificate.table import help_for, scope, verdict, violation
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.ultimate_bounds import HOLD


class ForceBounds(NamedTuple):
    """Bounds of the static contact force that a certificate claims; None if it claims none [N]."""

    motion: float | None
    """Largest at any time."""
    desired: float
    """Desired force."""
    error: float | None
    """Bound of the error in a hold, once the plan has stood at its target."""


def force_bounds(certificate: Certificate, limit: float | None, wrench: np.ndarray) -> ForceBounds:
    """Returns the bounds of the static force; those of a mission are the largest of its steps.

    Args:
        certificate: A certificate.
        limit: Largest static force of the plans and their tube [N], see `Contact.force_limit`.
        wrench: Desired 𝔉 (6,) of the task [N, N m].
    """
    bands = [(leg.force, band) for leg in certificate.legs
             if (band := leg.band if leg.hold_band is None else leg.hold_band) is not None]
    if bands:
        return ForceBounds(limit, *max(bands, key=sum))
    desired, bounds = np.asarray(wrench, dtype=float)[:3], certificate.bounds
    return ForceBounds(limit, float(np.linalg.norm(desired)),
                       bounds.get(HOLD, bounds.get("force")))


def tightest_limit(certificate: Certificate) -> Condition | None:
    """Returns the condition of the limit of which the tube takes the largest part."""
    limits = [each for each in certificate.conditions
              if each.kind == "tightening" and each.right > 0.0]
    return max(limits, key=lambda each: each.left / each.right, default=None)


def format_overview(certificate: Certificate, force: ForceBounds, seconds: float | None = None
                    ) -> str:
    """Returns the verdict, its assumptions, five numbers, and the failed conditions.

    Args:
        certificate: Certificate of the scenario.
        force: Its bounds of the static force.
        seconds: Time of its computation [s], if it is to be told.
    """
    lines = [f"{certificate.scenario}: {verdict(certificate)}", *scope(certificate), ""]
    if certificate.certified:
        lines += _numbers(certificate, force)
    if seconds is not None:
        lines.append(f"{'computed in':<18}{seconds:.1f} s")
    return "\n".join([*lines, *_failures(certificate)]).rstrip()


def format_force(force: ForceBounds) -> str:
    """Returns the largest static force in motion and in a hold; empty if none is claimed."""
    if force.error is None:
        return ""
    motion = "not limited" if force.motion is None else f"{force.motion:.4g} N"
    return (f"{motion} in motion, {force.desired + force.error:.4g} N in a hold of "
            f"{force.desired:.4g} ± {force.error:.3g} N")


def _numbers(certificate: Certificate, force: ForceBounds) -> list[str]:
    """Returns a line each for force, end-effector, tightest limit and proven numbers."""
    rows = []
    bounds = certificate.bounds
    if text := format_force(force):
        rows.append(("largest force", f"{text}; static, without impact and damping"))
    if "position" in bounds:
        rows.append(("end-effector", f"within {1e3 * bounds['position']:.3g} mm and "
                     f"{1e3 * bounds['orientation']:.3g} mrad of the plan"))
    if tightest := tightest_limit(certificate):
        rows.append(("tightest limit", f"{tightest.about}: the tube takes "
                     f"{100.0 * tightest.left / tightest.right:.3g} %, "
                     f"{tightest.margin:.3g} of {tightest.right:.3g} is left for the plan"))
    if certificate.tightening:
        estimated = certificate.tightening - certificate.proven
        rows.append(("proven", f"{certificate.proven} of the {certificate.tightening} numbers that "
                     f"tighten limits; {estimated} estimated"))
    return [f"{name:<18}{text}" for name, text in rows]


def _failures(certificate: Certificate) -> list[str]:
    """Returns the conditions that do not hold, each with its excess and advice."""
    failed = [each for each in certificate.conditions if not each.holds]
    if not failed:
        return []
    lines = ["", "does not hold"]
    for each in failed:
        lines.append(f"  {violation(each)}")
        if advice := help_for(each):
            lines.append(f"    {advice.removeprefix('; ')}")
    return lines
