"""Tests of the command `campaign`: bad input, a replay's options, and robots of others."""

import pytest
from support.campaigns import SHORT, refusal
from support.robots import copied

from uvms_drake.command.main import main


@pytest.mark.parametrize(("args", "words"), [
    (["--runs", "0"], "--runs = 0: must be at least 1"),
    (["--runs", "many"], "invalid int value"),
    (["--seed", "-1"], "--seed = -1"),
    (["--set", "seed=4"], "--set = 'seed=4': must be --seed N"),
    (["--workers", "0"], "--workers = 0"),
    (["--outside"], "unrecognized arguments: --outside"),
    (["--model-error", "0.2"], "unrecognized arguments: --model-error"),
    (["--set", "model_error.drag=-1"], "model_error.drag"),
    (["--workers", "1", "--scheduler", "tcp://127.0.0.1:1"], "not allowed with"),
    (["--set", "disturbance.bound=-1"], "disturbance.bound"),
    (["--set", "task.force=[900, 0, 0, 0, 0, 0]"], "task.force"),
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
    (["--uncertified"], "--uncertified = True"),
    (["--set", "duration=9"], "--set = ['duration=9']")])
def test_a_replay_takes_nothing_that_the_campaign_decides(tmp_path, capsys, args, said):
    command = ["campaign", "--replay", "2", "--output", str(tmp_path)]
    assert main([*command, *args]) == 2
    err = capsys.readouterr().err
    assert f"error: {said}" in err
    assert "must be left out with --replay: the campaign in the folder determines it" in err
    assert err.count("\n") == 1
    assert main([*command, "--runs", "100"]) == 2  # The default is as good as nothing.
    assert "left out" not in capsys.readouterr().err


INCLUDED = """<sdf version="1.9"><model name="whole">
  <include merge="true"><uri>package://whole/box_urdf.urdf</uri></include>
</model></sdf>"""


@pytest.mark.parametrize("is_included", [False, True])
def test_a_robot_of_a_urdf_is_taken_before_anything_takes_long(
        is_included, tmp_path, capsys, monkeypatch):
    robot = copied("campaign_of_a_urdf/box_urdf", tmp_path, *(
        [("package.xml", "<name>box_urdf", "<name>whole")] if is_included else []))
    if is_included:  # Its file is one line that includes a URDF.
        (robot / "whole.sdf").write_text(INCLUDED, encoding="utf-8")
        robot = robot.rename(tmp_path / "whole")
    file = tmp_path / "press.yaml"
    assert main(["scenario", "--new", str(file), "--robot", str(robot), "--force", "10"]) == 0

    def certify(*args, **kwargs):
        raise AssertionError("it certifies")

    monkeypatch.setattr("uvms_drake.command.drawn_runs.certified_once", certify)
    with pytest.raises(AssertionError, match="it certifies"):
        main(["campaign", str(file), "--runs", "2", "--output", str(tmp_path / "out"), "--quiet"])


def test_a_campaign_ends_in_time_after_an_interrupt(tmp_path, monkeypatch):
    """What is done is kept, and no table of a part is written."""
    def interrupted(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr("uvms_drake.campaign.harness.run_all", interrupted)
    with pytest.raises(KeyboardInterrupt) as error:
        main([*SHORT, "--output", str(tmp_path)])
    assert "goes on with the others" in error.value.__notes__[0]
    assert not (tmp_path / "campaign.json").exists()
