"""Output of the commands, and robots for them."""

import shutil
from pathlib import Path

from uvms_drake.common.output import MANIFEST_FILE
from uvms_drake.model.description.robot_files import models_dir

DATA = {"scenario.yaml", "summary.json", "log.csv", "log.npz", "timing.npz"}
DATA_ONLY = ["--no-figures", "--no-replay"]


def written(folder: Path) -> set[str]:
    """Returns the names of the files in a folder, without the manifest."""
    return {path.name for path in folder.iterdir()} - {MANIFEST_FILE}


def broken_robot(tmp_path: Path, old: str, new: str) -> Path:
    """Returns a copy of the shipped robot with one text in its hydrodynamics file replaced."""
    folder = tmp_path / "girona500_arm5e"
    shutil.copytree(models_dir() / folder.name, folder)
    file = folder / "hydrodynamics.yaml"
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")
    return folder
