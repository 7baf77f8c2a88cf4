"""A first scenario with the advice of its certificate put in, until it certifies.

Its numbers are estimates, and the certificate computes them. A condition that fails has
an advice where a value is known, such as a smaller `disturbance.bound`: that is taken, as an owner
would take it, or else the disturbance is made smaller, and the certificate computed again.
"""

import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from uvms_drake.certificate.certificate import Certificate
from uvms_drake.certificate.certify import certified_once
from uvms_drake.certificate.text import violation
from uvms_drake.common.progress import Progress, silent
from uvms_drake.control.limits.inputs import input_names
from uvms_drake.setup.first_scenario import WEAKEST, FirstScenario
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.tube.conditions import Condition

ATTEMPTS = 5
"""Number of certificates that are computed at most."""
LESS = 0.7
"""Part of the disturbance that is kept where a condition fails without a number that helps."""


def settle(found: FirstScenario, text_of: Callable[[FirstScenario], str], file: Path,
           progress: Progress = silent) -> Certificate:
    """Writes a scenario, with tube and terminal set of its certificate, and returns that.

    Args:
        found: Its numbers.
        text_of: Function that returns the text of its file.
        file: The scenario's.
        progress: As of `certify`.
    """
    settings: dict[str, str] = {}

    def write() -> None:
        file.write_text(with_settings(text_of(found), settings), encoding="utf-8")

    for _ in range(ATTEMPTS):
        write()
        certificate = certified_once(load_scenario(str(file)), progress)
        if certificate.failed is None:
            break
        advice = certificate.failed.advice
        share = 1.0 if advice else LESS
        for setting in shlex.split(advice)[1::2]:
            key, _, value = setting.partition("=")
            if key == "disturbance.bound":
                share = float(value) / float(found.disturbance[0])
            else:
                settings[key] = value
        if share * found.covered < WEAKEST:
            break
        found = found.weaker(share)
    if certificate.certified and certificate.tube is not None and certificate.terminal is not None:
        found = replace(found, tube=certificate.tube, source="those of its certificate",
                        terminal_radius=certificate.terminal.radius)
        write()
    return certificate


def with_settings(text: str, settings: dict[str, str], why: str = "by advice of the certificate"
                  ) -> str:
    """Returns the text of a scenario with values by their keys, `section.name` or a name alone.

    Args:
        text: The text.
        settings: The values.
        why: Comment of each.
    """
    for key, value in settings.items():
        section, _, name = key.rpartition(".")
        within = rf"{section}:.*\n(?:[ #].*\n)*?  " if section else ""
        line = re.compile(rf"^({within}{name}: )[^#\n]*?( *#.*)?$", re.M)
        if not re.search(f"^{section or name}:", text, flags=re.M):
            text += f"\n{section or name}:{'' if section else ' 0'}\n"
        if not line.search(text):
            text = re.sub(rf"^{section}:.*$", rf"\g<0>\n  {name}: 0", text, flags=re.M)
        text = line.sub(rf"\g<1>{value}  # {why}", text)
    return text


def overlaid(text: str, other: str) -> str:
    """Returns a text with the paragraphs of another one, in place of those with that key."""
    paragraphs = {}
    for each in [*text.strip("\n").split("\n\n"), *other.strip("\n").split("\n\n")]:
        key = re.search(r"^\w+:", each, re.M)
        paragraphs[key[0] if key else ""] = each
    return "\n\n".join(paragraphs.values()) + "\n"


def forbidding(found: FirstScenario, failed: Condition) -> str:
    """Returns the number of the robot that forbids a certificate, and by how much."""
    names = dict(zip((f"u_{name}" for name in input_names(len(found.posture))),
                     found.strength.names, strict=True)) | {"qdot": "the velocity of its joints"}
    because = f", because of {names[failed.about]}" if failed.about in names else ""
    return f"not with this robot{because}: {violation(failed)}"
