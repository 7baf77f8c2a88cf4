"""Files of others with one random mistake: refused, told by a line, or read as NumPy reads them.

Masses and inertias of the whole robot about its vehicle, its added mass and its axes are compared;
a line is one that the list of the file without the mistake does not have.
"""

import random
import shutil
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from support.pages import ROOT
from support.robot_files import FILES, PlainUrdf
from support.robot_mutations import mutated_xml

import uvms_drake as uv
from uvms_drake.model.description.hydrodynamics_file import added_mass_about_origin
from uvms_drake.model.robot_import.importer import import_robot
from uvms_drake.plant.model_check import sound_robot

CASES = ROOT / "tests" / "field_cases"
SOURCES = {CASES / "uuv_added_mass_axes" / "scout.urdf": "scout/base_link",
           CASES / "wings_and_mast" / "glider.urdf": "hull",
           CASES / "collada_nodes" / "rov.urdf": "hull",
           FILES / "dae_arm.urdf": "rov/base_link", FILES / "rounded.urdf": "rov/base_link",
           FILES / "dummy_root.urdf": "hull"}
"""Files, and their vehicles."""
ORDER = [3, 4, 5, 0, 1, 2]


def plain_added_mass(file: Path, link: str) -> np.ndarray | None:
    """Returns M_A (6, 6) of a link in a plugin of uuv_simulator, FRD; None without one."""
    for node in ElementTree.parse(file).getroot().iterfind("gazebo/plugin/link"):
        text = node.findtext("hydrodynamic_model/added_mass")
        if node.get("name") == link and text is not None:
            M = np.array([float(word) for word in text.split()])
            M = np.diag(M) if len(M) == 6 else M.reshape(6, 6)
            return 0.5 * (M + M.T)
    return None


def outcome(file: Path, vehicle: str, known: set[str], folder: Path) -> str:
    """Returns what becomes of a file with a mistake, or what is wrong with that."""
    try:
        imported = import_robot(file, "found")
        for path, data in imported.files.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_bytes(data)
        robot = sound_robot(str(folder))
    except uv.InvalidParameter as error:
        return "refused" if str(error) else "refused without a line"
    notes = imported.notes
    if {*notes.taken, *notes.changed, *notes.asked} - known:
        return "told"
    # Silent: then it is the robot of the file, legal as that is.
    plant = robot.uvms.plant
    M = plant.CalcSpatialInertia(
        plant.CreateDefaultContext(), robot.uvms.vehicle.body_frame(),
        plant.GetBodyIndices(robot.uvms.model_instance)).CopyToFullMatrix6()[np.ix_(ORDER, ORDER)]
    try:
        expected = PlainUrdf(file, {}).inertia_about(vehicle)
        added = plain_added_mass(file, vehicle)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        return f"read, though the file is not legal: {error!r}"
    found = added_mass_about_origin(robot.uvms.hydrodynamics.bodies["vehicle"].added_mass)
    if not np.allclose(M, expected, rtol=1e-5, atol=1e-6 * np.max(np.abs(expected))):
        return "silent in mass or axes"
    if added is not None and not np.allclose(found, added, atol=1e-6 * np.max(np.abs(added))):
        return "silent in added mass"
    return "read as it is"


@pytest.mark.parametrize("seeds", [
    range(40), pytest.param(range(40, 1040), marks=pytest.mark.long)], ids=["few", "many"])
def test_no_mistake_is_silent_in_mass_added_mass_and_axes(seeds, tmp_path):
    files = dict(enumerate(SOURCES))
    lists = {}
    for file in SOURCES:
        notes = import_robot(file, "found").notes
        lists[file] = {*notes.taken, *notes.changed, *notes.asked}
    for folder in {file.parent for file in SOURCES}:
        shutil.copytree(folder, tmp_path / folder.name)
    found: dict[str, list[str]] = {}
    for seed in seeds:
        rng = random.Random(seed)
        source = files[rng.randrange(len(files))]
        text, told = mutated_xml(source.read_text("utf-8"), rng)
        file = tmp_path / source.parent.name / source.name
        file.write_text(text, encoding="utf-8")
        robot = tmp_path / str(seed) / "found"
        found.setdefault(outcome(file, SOURCES[source], lists[source], robot), []).append(
            f"{seed}, {source.name}: {told}")
    counts = Counter({key: len(cases) for key, cases in found.items()})
    print(counts)
    assert {key: cases for key, cases in found.items()
            if key not in ("refused", "told", "read as it is")} == {}
    assert counts["refused"] + counts["told"] > 0.3 * len(seeds)
