"""The inputs of `tests/field_cases`: robots of other people's files that were taken wrongly."""

import shutil
from pathlib import Path

FIELD_CASES = Path(__file__).parents[1] / "field_cases"


def copied(case: str, folder: Path, *changes: tuple[str, str, str]) -> Path:
    """Returns a copy in `folder` of a case's robot, texts replaced: (suffix of the file, old, new).

    Every place where the old text stands is changed; it must be there.
    """
    robot = folder / Path(case).name
    shutil.copytree(FIELD_CASES / case, robot)
    for suffix, old, new in changes:
        (file,) = robot.glob(f"*{suffix}")
        text = file.read_text(encoding="utf-8")
        assert old in text, (suffix, old)
        file.write_text(text.replace(old, new), encoding="utf-8")
    return robot
