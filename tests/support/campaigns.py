"""A short campaign, and readings of its folder."""

import json
from pathlib import Path

from uvms_drake.campaign.store import RUNS_FILE
from uvms_drake.command.main import main

RUNS = 3
CLOSE = ["--set", "start.eta=[-1.13, -0.05, -0.05, 0.02, 0.02, 0.05]"]
"""The tip starts a few centimetres off the wall, so that even a short run makes contact."""
WALLS = ((1.25, 0.0), (1.0, 0.1))
"""Stiffness over the scenario's and tilt [rad] of the surfaces that are certified."""
SHORT = ["campaign", "girona500_ideal", "--uncertified", "--set", "duration=0.6", *CLOSE,
         "--seed", "3"]


def result_bytes(folder: Path) -> bytes:
    return (folder / "campaign.json").read_bytes()


def indices_in(folder: Path) -> list[int]:
    lines = (folder / RUNS_FILE).read_text(encoding="utf-8").splitlines()
    return [json.loads(line)["result"]["index"] for line in lines]


def refusal(capsys, *args) -> str:
    """Runs with bad input and returns the only line on stderr."""
    assert main([*SHORT, *args]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err
