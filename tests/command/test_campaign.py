"""Tests of `uvms_drake.command.campaign.campaign`."""


import pytest
from support.campaigns import refusal
from support.field import copied

from uvms_drake.campaign.model_uncertainty import check_draws
from uvms_drake.command.campaign import campaign as module
from uvms_drake.command.main import main
from uvms_drake.plant import model_error
from uvms_drake.station.scenario.scenario import load_scenario


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


# What may be drawn is tried before anything takes long --------------------------------------------

CASE = "campaign_of_a_urdf/box_urdf"
INCLUDED = """<sdf version="1.9"><model name="whole">
  <include merge="true"><uri>package://whole/box_urdf.urdf</uri></include>
</model></sdf>"""
MESH = '<visual><geometry><mesh filename="hull.obj"/></geometry></visual>'
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"


def included(folder):
    """Returns a robot whose file is one line that includes a URDF."""
    robot = copied(CASE, folder, ("package.xml", "<name>box_urdf", "<name>whole"))
    (robot / "whole.sdf").write_text(INCLUDED, encoding="utf-8")
    return robot.rename(folder / "whole")


def with_a_mesh(folder):
    """Returns a robot with a mesh that its file names by a path beside it."""
    link = '<link name="vehicle">'
    robot = copied(CASE, folder, (".urdf", link, link + MESH))
    (robot / "hull.obj").write_text(TRIANGLE, encoding="utf-8")
    return robot


@pytest.fixture
def nothing_long(monkeypatch):
    """Fails where a certificate would be computed."""
    def certify(*args, **kwargs):
        raise AssertionError("it certifies")

    monkeypatch.setattr(module, "certified_once", certify)


def scenario_for(robot, folder) -> str:
    file = folder / "press.yaml"
    assert main(["scenario", "--new", str(file), "--robot", str(robot), "--force", "10"]) == 0
    return str(file)


def test_a_robot_that_cannot_be_drawn_otherwise_is_refused_at_once(
        tmp_path, capsys, nothing_long, monkeypatch):
    """Where the masses of a file are not to be found, nothing of it is scaled."""
    file = scenario_for(copied(CASE, tmp_path), tmp_path)
    capsys.readouterr()
    output = tmp_path / "out"
    with monkeypatch.context() as patch:
        patch.setattr(model_error, "scaled_files", lambda files, factor: files)
        assert main(["campaign", file, "--runs", "2", "--output", str(output)]) == 2
    err = capsys.readouterr().err
    assert ("--model-error = 0.2: must be 0 for this robot, or numbers in its file: a campaign "
            "draws errors up to this, and ") in err
    assert ("model_error.mass must be 1 for this robot: its file does not give the mass and the "
            "inertia of 'vehicle' by numbers of its own") in err
    assert err.count("\n") == 1
    assert not output.exists()
    # As it says: without errors of the model nothing is in the way of the certificate.
    with pytest.raises(AssertionError, match="it certifies"):
        main(["campaign", file, "--runs", "2", "--output", str(output), "--model-error", "0",
              "--quiet"])


@pytest.mark.parametrize("make", [lambda folder: copied(CASE, folder), included, with_a_mesh],
                         ids=["urdf", "included", "mesh"])
def test_a_robot_of_a_urdf_is_taken(make, tmp_path, capsys, nothing_long):
    file = scenario_for(make(tmp_path), tmp_path)
    with pytest.raises(AssertionError, match="it certifies"):
        main(["campaign", file, "--runs", "2", "--output", str(tmp_path / "out"), "--quiet"])


@pytest.mark.parametrize("scenario", ["girona500_ideal", "bluerov2_ideal"])
def test_the_shipped_robots_are_taken(scenario):
    shipped = load_scenario(scenario)
    check_draws(shipped.model, shipped.model_error, 0.5)
