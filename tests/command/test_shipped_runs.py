"""Tests of every shipped certified scenario: its run keeps all guarantees, whatever the seed."""

import json

import pytest
from support.outputs import DATA_ONLY

from uvms_drake.command.main import main
from uvms_drake.station.scenario.scenario_file import shipped_scenarios

pytestmark = pytest.mark.slow

NOT_CERTIFIED = ("girona500_real_loop", "bluerov2_real_loop", "jacket_inspection_real",
                 "paper_kinematic")
OF_THE_PAPER = "paper_kinematic_certified"
"""Has a simulation, and a summary, of its own."""
CHEAP = ("girona500_ideal", 0)


@pytest.mark.parametrize(("name", "seed"), [
    (name, seed) if (name, seed) == CHEAP else pytest.param(name, seed, marks=pytest.mark.long)
    for name in shipped_scenarios() if name not in NOT_CERTIFIED for seed in range(3)])
def test_a_certified_run_as_it_is_shipped_keeps_all_guarantees(name, seed, tmp_path, capsys):
    assert main(["run", name, "--seed", str(seed), "--quiet", *DATA_ONLY,
                 "--output", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "all guarantees kept"
    if name != OF_THE_PAPER:
        summary = json.loads((tmp_path / "out" / "summary.json").read_text("utf-8"))
        assert summary["verdict"] == {"status": 0, "text": "all guarantees kept"}
        assert not summary["contact"].get("out_of_class")
