"""D24: a distance in the text of a scenario is that of its start, not one of three numbers."""

import re

import numpy as np
import pytest

import uvms_drake as uv
from uvms_drake.report.signals import surface_depth
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.problem import true_surface
from uvms_drake.station.scenario.scenario_file import shipped_scenarios

SAID = re.compile(r"(\d\.\d+) m (?:off|to a)\b")
FILES = {name: path.read_text(encoding="utf-8") for name, path in shipped_scenarios().items()}


@pytest.mark.parametrize("name", [name for name, text in FILES.items() if SAID.search(text)])
def test_the_distance_that_a_scenario_names_is_that_of_its_start(name):
    scenario = uv.load_scenario(name)
    model, surface = uv.load_model(scenario), true_surface(scenario)
    chi = model.task_pose(scenario.start.config)[None, :6]
    desired = np.asarray(scenario.task.force, dtype=float)[:3]
    n = (sensed_contact(scenario).direction if isinstance(scenario.contact, uv.SensedContact)
         else desired / np.linalg.norm(desired))
    away = float((surface_depth(surface, chi, n) - chi[:, :3] @ n)[0])
    said = {float(number) for number in SAID.findall(FILES[name])}
    assert len(said) == 1, "one number in one file"
    assert away == pytest.approx(said.pop(), abs=0.05)
