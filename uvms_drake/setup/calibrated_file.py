"""File of a calibrated scenario: that of the scenario with the found numbers, each with its origin.

The text stays as it is but for the tube, which is written anew, and for the lines of the numbers
that were found. So a file that was calibrated is calibrated again to itself.
"""

import re

import numpy as np

from uvms_drake.control.laws.tip_first import TipFirst
from uvms_drake.setup.calibrate import FILLED, SETTLED, SHARE, SLOWER, Calibration
from uvms_drake.setup.settle import with_settings

UNITS = {"e": "m, rad", "position": "m", "depth": "m", "orientation": "rad", "joints": "rad",
         "z": "m/s, rad/s", "nu1": "m/s", "nu2": "rad/s", "qdot": "rad/s", "tip_speed": "m/s",
         "depth_speed": "m/s", "between_knots": "m", "roll": "rad", "pitch": "rad",
         "u": "m/s2 (3), rad/s2", "tau": "N (3), N m"}
"""Units of the radii."""
COLUMN = 34
"""Column of the comments."""


def calibrated_text(text: str, found: Calibration, command: str = "") -> str:
    """Returns the text of a scenario's file with tube, gains and derived numbers.

    Args:
        text: Text of the scenario's file.
        found: Its calibration.
        command: The command that found it, for a comment.
    """
    scenario, law = found.scenario, found.scenario.ancillary
    assert isinstance(law, TipFirst)
    numbers = {
        "the plan's speed and the tube's": {
            f"contact.{key}": f"{getattr(scenario.contact, key):g}"
            for key in ("speed", "speed_across")},
        f"s, {SETTLED:g} time constants of the slower observer": {
            "mpc.hover": f"{scenario.mpc.hover:g}"},
        "the largest terminal set within the tightened limits": {
            "mpc.terminal_radius": f"{scenario.mpc.terminal_radius:g}"}}
    if found.longer:
        numbers["s, longer by the hover"] = {"duration": f"{scenario.duration:g}"}
    if found.scale is not None:
        why = f", the best one with {SLOWER:g} times the delays" if found.runs else ""
        numbers[f"1/s; of the scale {found.scale:g}{why}"] = {f"ancillary.{key}": "{" + ", ".join(
                    f"{name}: {value:g}" for name, value in vars(getattr(law, key)).items()) + "}"
                    for key in ("vehicle", "tip")}
    for why, settings in numbers.items():
        text = with_settings(text, settings, why)
    text = re.sub(r"^tube:.*\n(?: .*\n|\n(?= ))*", "", text.rstrip("\n") + "\n", flags=re.M)
    return "\n".join([text.rstrip("\n"), "", *_tube(found, command), ""])


def _tube(found: Calibration, command: str) -> list[str]:
    """Returns the lines of the tube."""
    lines = [
        "tube:",
        f"  # Of {found.runs} pilot runs, of a seed of their own, by `{command}`:",
        f"  # a radius is {found.multiple:.3g} times their largest deviation or more, and up to "
        f"{FILLED:g} times where that is less",
        f"  # than {SHARE:g} of the limit. In brackets that deviation and the radius' part of the "
        "limit."] if found.runs else ["tube:  # a guess, with which pilot runs begin"]
    for key, value in vars(found.scenario.tube).items():
        if key == "tau" and value is None:
            lines.append(f"{'  tau: null':<{COLUMN - 1}} # as `limits.tau`")
        if value is None or not np.any(value):
            continue
        rows = [(name, row) for name, row in found.rows.items()
                if name == key or (key in ("u", "tau") and name.startswith(f"{key}_"))]
        said = "({}{})".format(
            ", ".join(f"{row.largest:.2g}" for _, row in rows),
            "".join(f"; {row.radius / row.available:.0%}" for _, row in rows
                    if len(rows) == 1 and np.isfinite(row.available))) if rows else ""
        text = f"[{', '.join(f'{part:g}' for part in value)}]" if np.ndim(value) else f"{value:g}"
        if np.ndim(value) and said:
            lines.append(f"  # {said}")
            said = ""
        lines.append(f"{f'  {key}: {text}':<{COLUMN - 1}} # {UNITS[key]} {said}".rstrip())
    return lines
