"""Bad command lines: exit status 2, one line on stderr with the key, and nothing written."""

import shlex

import pytest
from support.refusals import OBJECT
from support.robot_files import FILES

from uvms_drake.command.main import main

RUN = "run girona500_ideal --uncertified --duration 0.2"
OVERRIDES = {
    "--seed x": "seed = 'x': must be a whole number",
    "--seed -1": "(girona500_ideal.yaml with --set duration=0.2 --set seed=-1)",
    "--duration -1": "duration = -1.0: must be positive",
    "--set surface.stifness=3": "surface.stifness = 3: must be under one of the keys point",
    "--set 'task.pose=[0, 0, 0, 0, 1.5, 0]'": "must be such that vehicle pitch, 1.5,",
    "--set 'limits.tau=[9, 9, 9, 9, 9, 9, 9, 9, 9, 9]'": "left out, unless tube.tau has",
    "--set model=girona501": "model = 'girona501': must be one of bluerov2_alpha5, ",
    "--set start.q.0=1.6": "start.q = [1.6",
    "--set limits.nu1=0.001": "limits.nu1 = 0.001: must be ",
    "--set ancillary.k=1e9 --set simulator.max_step_size=0.02":
        "simulator.max_step_size = 0.02: must be at most 1.1e-09 s",
    "--set 'current=[1e6, 0, 0]' --set simulator.max_step_size=0.02":
        "simulator.max_step_size = 0.02: must be at most ",
    "--set task.force_tolerance=25": "smaller than the desired force itself, 20 N",
    "--set mpc.horizon=100000": "one plan would take 2.5e+04 GB of memory",
    "--set log_period=1e-8": "0.2 s would take about 80 GB of memory",
    "--set simulator.max_step_size=1e-9": "0.2 s would take about 56 hours",
    "--set 'name=\"a\\0b\"'": "must be usable as the name of a folder",
    "--set 'task.force=[-5, 0, 0, 0, 0, 0]'": "task.force = [-5., 0., 0., 0., 0., 0.]: must"}
"""Options of a run of 0.2 s, and a text of the line that refuses each."""
REFUSED = {
    "": "", "fly": "'fly'", "scenarios x": "unrecognized arguments: x", "keys nothing": "'nothing'",
    "run --verbose": "unrecognized arguments: --verbose (see uvms-drake run --help)",
    "run a b": "unrecognized arguments: b", "run --seed": "--seed",
    "run --meshcat --host 192.0.2.1 --uncertified": "host = '192.0.2.1'",
    "run girona500_contcat": "did you mean 'girona500_contact'?",
    "run mine.yml": "scenario = 'mine.yml': must be a file that exists, or one",
    "run /": "scenario = '/': must be a file: this is a folder",
    "run girona500_bilateral --uncertified --set surface.stiffness.0.1=99": "it is not symmetric",
    "run girona500_bilateral --set surface.equilibrium.2=1e60": "a number between ±1e+50",
    "run /dev/null": "/dev/null", f"run {'n' * 300}": "scenario = ", "run a\0b": "scenario = ",
    "run --output file/out": "--output = 'file/out': must be a folder that can be",
    "run --output ''": "must be the name of a folder",
    f"certify --output {'n' * 300}": "must be the name of a folder",
    "campaign --output a\0b": "must be the name of a folder",
    "errata --output ''": "must be the name of a folder",
    "plot nowhere": "nowhere", "plot .": ".",
    "certify --uncertified": "unrecognized", "certify girona500_tip_first --paper": "unrecognized",
    "certify --set certificate.terminal_samples=1e12": "certificate.terminal_samples",
    "certify --runs 0": "--runs = 0: must be at least 1",
    "certify --runs 2 --confidence 1": "--confidence = 1.0: must be at least 0.5 and below 1",
    "certify --runs 2 --set seed=4": "--set = 'seed=4': must be left out",
    "certify --runs 2 --seed 4": "unrecognized arguments: --seed",
    "campaign --seed 4294967296": "--seed = 4294967296: must be zero or positive, below",
    "certify --runs 2 --largest seed": "--largest = 'seed': must be left out with --runs",
    "certify --workers 2": "--workers = 2: must be left out without --runs",
    "campaign --runs many": "invalid int value", "campaign --seed -1": "--seed = -1",
    "campaign --workers 0": "--workers = 0", "campaign --model-error 0.2": "unrecognized arguments",
    "campaign --workers 1 --scheduler tcp://127.0.0.1:1": "not allowed with",
    "campaign --set model_error.drag=-1": "model_error.drag",
    "campaign --set mpc.deadline=0.1": "mpc.deadline",
    "campaign --set 'faults=[!FrozenState {start: 1}]'": "faults = ['FrozenState']",
    "campaign --replay 2 --seed 4": "--seed = 4: must be left out with --replay: the campaign in",
    "campaign --replay 2 --set duration=9": "--set = ['duration=9']: must be left out with --rep",
    "campaign --replay 2 --uncertified": "--uncertified = True: must be left out with --replay",
    "robot --new my-robot": "--new = 'my-robot': must be a folder by the name of the robot",
    "robot --new there": "--new = 'there': must be a folder that is not there yet",
    "robot --new /dev/null/mine": "--new = '/dev/null/mine': must be a path that can be written",
    "robot box_uvms --new mine": "ROBOT = 'box_uvms': must be a robot's name or folder; or",
    "robot": "ROBOT = None: must be a robot's name or folder",
    "robot --new mine --output out": "--output = 'out': must be left out, with --new",
    "robot --new mine --posture 0.1": "--posture = [0.1]: must be left out, with --new",
    "robot --from a.urdf mine --posture 0.1": "--posture = [0.1]: must be left out, with --from",
    "run --no-wait": "--no-wait = True: must be left out without --meshcat",
    "scenario --check girona500_ideal --force 8": "--force = 8.0: must be left out with --check",
    "robot box_uvms --posture 0.1": "--posture = [0.1]: must be 2 finite numbers",
    "robot submarine": "model = 'submarine': must be one of bluerov2_alpha5, box_uvms,",
    "robot --from light.urdf there": "--from = 'there': must be a folder that is not there",
    "robot --from no.urdf found": "--from = 'no.urdf': must be a file that can be read (No su",
    "robot --from bytes.urdf found": "--from = 'bytes.urdf': must be a text in UTF-8",
    "robot --from page.urdf found": "must be URDF (<robot>) or SDFormat (<sdf>), not <html>",
    "robot --from empty.urdf found": "--from = 'empty.urdf': must be a robot with links",
    "robot --from light.urdf found": "must be a robot with masses: no link has an <inertial>",
    f"robot --from {FILES / 'nested.sdf'} /dev/null/found": "'/dev/null/found': must be a path",
    "robot box_uvms --from light.urdf found": "ROBOT = 'box_uvms': must be",
    "scenario --new x.yaml": "--robot = ",
    "scenario --check girona500_ideal --robot girona500_arm5e": "--robot = "}
"""Command lines, the same."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with files in the way and bad robots, in which the command is given."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there").mkdir()
    for name, content in (
            ("file", b"in the way"), ("page.urdf", b"<html/>"), ("empty.urdf", b"<robot/>"),
            ("light.urdf", b'<robot><link name="base"/></robot>'), ("bytes.urdf", b"\xff\xfe\0<")):
        (tmp_path / name).write_bytes(content)
    return tmp_path


@pytest.mark.parametrize(("line", "text"), [
    *REFUSED.items(), *((f"{RUN} {options}", text) for options, text in OVERRIDES.items())])
def test_a_bad_command_line_is_refused_in_a_line_and_nothing_is_written(
        line, text, folder, capsys):
    before = sorted(folder.rglob("*"))
    assert main(shlex.split(line)) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith("uvms-drake: error: ")
    assert text in err
    assert len(err) < 800
    assert not OBJECT.search(err)
    assert sorted(folder.rglob("*")) == before
