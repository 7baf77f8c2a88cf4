"""Scenarios of a text."""

import pytest

from uvms_drake.common.errors import ScenarioError
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.scenario.scenario_file import shipped_scenarios

OF_A_STATION = tuple(name for name in shipped_scenarios() if "kinematic" not in name)
"""Shipped scenarios but for those with a simulation of their own."""
ALIKE = ("bluerov2_cp_probe", "girona500_contact_uncertain", "girona500_floor", "girona500_slope")
"""Those whose controller has the parts of another one's."""
UNLIKE_FIRST = tuple(pytest.param(name, marks=pytest.mark.long) if name in ALIKE else name
                     for name in OF_A_STATION)
"""The same as parameters of a test; those that are alike are `long`."""


def load_text(tmp_path, text, overrides=()):
    path = tmp_path / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return load_scenario(str(path), overrides)


def error_of(*args):
    with pytest.raises(ScenarioError) as caught:
        load_scenario(*args)
    assert "\n" not in str(caught.value)
    return str(caught.value)
