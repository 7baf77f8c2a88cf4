"""Stored texts of the commands: what a user reads, in one file a command.

`UPDATE_SNAPSHOTS=1 pytest ...` writes them again; look at `git diff tests/snapshots` then.
"""

import os
import re
from pathlib import Path

FOLDER = Path(__file__).parent.parent / "snapshots"
NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def shape_of(text: str, *folders: Path) -> str:
    """Returns a text with `#` for each number, `DIR` for each folder, and single blanks.

    Wording and order are compared, for numbers depend on the kernel of the BLAS; those that
    matter have tests of their own.
    """
    for folder in folders:
        text = text.replace(str(folder), "DIR")
    lines = (re.sub(r"[ \t]+", " ", NUMBER.sub("#", line)).rstrip() for line in text.splitlines())
    return "\n".join(lines).strip() + "\n"


def check_snapshot(name: str, text: str, *folders: Path) -> None:
    """Compares a text with `tests/snapshots/NAME.txt` up to numbers and folders."""
    path, found = FOLDER / f"{name}.txt", shape_of(text, *folders)
    if os.environ.get("UPDATE_SNAPSHOTS"):
        path.write_text(found, encoding="utf-8")
    assert found == path.read_text(encoding="utf-8"), f"{path.name} differs"
