"""Tests of `uvms_drake.command.campaign`."""


import pytest
from support.campaigns import refusal

from uvms_drake.command.main import main


@pytest.mark.parametrize(("args", "words"), [
    (["--runs", "0"], "--runs = 0: must be at least 1"),
    (["--runs", "many"], "invalid int value"),
    (["--seed", "-1"], "--seed = -1"),
    (["--set", "seed=4"], "--set = 'seed=4': must be --seed N"),
    (["--workers", "0"], "--workers = 0"),
    (["--model-error", "2"], "--model-error = 2.0"),
    (["--set", "model_error.drag=-1"], "model_error.drag"),
    (["--workers", "1", "--scheduler", "tcp://127.0.0.1:1"], "not allowed with"),
    (["--set", "disturbance.bound=-1"], "disturbance.bound"),
    (["--set", "task.force=[900, 0, 0, 0, 0, 0]"], "limits.static_force"),
    (["--outside", "--model-error", "0"], "--model-error = 0.0"),
    (["--set", "mpc.deadline=0.1"], "mpc.deadline"),
    (["--set", "faults=[!FrozenState {start: 1}]"], "faults = ['FrozenState']"),
])
def test_bad_input_is_one_line_and_nothing_is_written(capsys, tmp_path, args, words):
    output = tmp_path / "result"
    assert words in refusal(capsys, "--output", str(output), *args)
    assert not output.exists()


@pytest.mark.parametrize(("args", "said"), [
    (["--runs", "5"], "--runs = 5"), (["--seed", "4"], "--seed = 4"),
    (["--workers", "1"], "--workers = 1"), (["--scheduler", "tcp://x:1"], "--scheduler = 'tcp:"),
    (["--uncertified"], "--uncertified = True"), (["--model-error", "0"], "--model-error = 0.0"),
    (["--set", "duration=9"], "--set = ['duration=9']")])
def test_a_replay_takes_nothing_that_the_campaign_decides(tmp_path, capsys, args, said):
    command = ["campaign", "girona500_ideal", "--outside", "--replay", "2",
               "--output", str(tmp_path)]
    assert main([*command, *args]) == 2
    err = capsys.readouterr().err
    assert f"error: {said}" in err
    assert "must be left out with --replay: the campaign in the folder determines it" in err
    assert err.count("\n") == 1
    assert main([*command, "--runs", "100"]) == 2  # The default is as good as nothing.
    assert "left out" not in capsys.readouterr().err
