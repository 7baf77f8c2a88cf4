"""Tests of `certify`, and of `run` with a certificate: files, exit status, refusals.

All of them certify by few samples and searches; the use of the certificate is tested.
"""

import shlex
from contextlib import redirect_stdout
from io import StringIO

import numpy as np
import pytest
from support.outputs import DATA, DATA_ONLY, broken_robot, written
from support.quick import few_in_all_files

from uvms_drake.certificate.certificate import Certificate, read_certificate
from uvms_drake.command.main import main
from uvms_drake.report.summary import summarise
from uvms_drake.station.record import load_record
from uvms_drake.station.scenario.scenario import dump_scenario, load_scenario

pytestmark = pytest.mark.slow

NOT_CERTIFIED = ["--set", "disturbance.bound=0.2"]
"""Makes a tube that is larger than a limit of the shipped scenarios."""


@pytest.fixture(scope="module", autouse=True)
def few():
    with pytest.MonkeyPatch.context() as patch:
        few_in_all_files(patch)
        yield


@pytest.fixture(scope="module")
def certified(few, tmp_path_factory):
    """Runs half a second of the ideal scenario with a certificate: its folder and its messages."""
    output, said = tmp_path_factory.mktemp("certified") / "out", StringIO()
    with redirect_stdout(said):
        assert main(["run", "girona500_ideal", "--duration", "0.5", "--output", str(output),
                     *DATA_ONLY]) == 0
    return output, said.getvalue()


def certificate_of(folder) -> Certificate:
    return read_certificate(folder / "certificate.json")


def run_in(folder, *args):
    """Returns the status of a run of 0.1 s without --uncertified."""
    named = bool(args) and not args[0].startswith("--")
    return main(["run", *([] if named else ["girona500_ideal"]), "--duration", "0.1",
                 "--output", str(folder), *DATA_ONLY, *args])


@pytest.fixture
def committed(certified, tmp_path, capsys):
    """Returns a folder in which `certify` has left the certificate of the ideal scenario."""
    assert main(["certify", "girona500_ideal", "--output", str(tmp_path / "out")]) == 0
    capsys.readouterr()
    return tmp_path / "out"


def test_a_certified_run_writes_its_certificate_and_uses_its_tube(certified):
    output, said = certified
    assert written(output) == DATA | {"certificate.json"}
    assert "certified tube used" in said and said.count("\n") < 30
    certificate = certificate_of(output)
    assert (certificate.certified, certificate.made_by) == (True, "run")
    record = load_record(output)
    assert record.certified
    assert record.scenario.mpc.terminal_radius == certificate.terminal.radius
    tube = summarise(record)["tube"]
    assert (tube["bound_e"], tube["bound_z"]) == (certificate.tube.e, certificate.tube.z)
    assert (tube["certified"], tube["exits"]) == (True, 0)
    for name, value in vars(certificate.tube).items():
        np.testing.assert_array_equal(getattr(record.scenario.tube, name), value, err_msg=name)


def test_the_written_scenario_of_a_certified_run_runs_again_to_the_same_log(
        certified, tmp_path, capsys):
    output, _ = certified
    assert main(["run", str(output / "scenario.yaml"), "--output", str(tmp_path),
                 *DATA_ONLY]) == 0
    for name in ("certificate.json", "log.npz", "scenario.yaml"):
        assert (tmp_path / name).read_bytes() == (output / name).read_bytes(), name


def test_certify_writes_the_certificate_and_nothing_else(certified, tmp_path, capsys):
    assert main(["certify", "girona500_ideal", "--output", str(tmp_path / "out")]) == 0
    out, err = capsys.readouterr()
    assert err == f"written to {tmp_path / 'out'}: certificate.json\n"
    assert out.startswith("girona500_ideal: certified: all ")
    assert "law resolved, k = " not in out
    assert out.splitlines()[-1] == "everything: --full"
    assert main(["certify", "girona500_ideal", "--full", "--output", str(tmp_path / "out")]) == 0
    out, _ = capsys.readouterr()
    assert "law resolved, k = 20 1/s" in out
    assert "\nconditions\n" in out
    assert out.splitlines()[-1].startswith("certified: all ")
    assert written(tmp_path / "out") == {"certificate.json"}
    certificate = certificate_of(tmp_path / "out")
    assert (certificate.certified, certificate.made_by) == (True, "certify")


def test_what_is_computed_is_kept_between_processes(certified, cache, capsys, tmp_path):
    kept = {path: path.stat().st_mtime_ns for path in cache.rglob("*.json")}
    assert main(["certify", "girona500_ideal", "--output", str(tmp_path)]) == 0
    assert kept
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


def test_a_void_certificate_has_exit_status_1_and_says_what_failed(capsys, tmp_path):
    assert main(["certify", "girona500_ideal", *NOT_CERTIFIED, "--output", str(tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert err.splitlines()[-1] == f"written to {tmp_path}: certificate.json"
    assert out.startswith("girona500_ideal: not certified: tube in limits.u_")
    assert "\ndoes not hold\n  tube in limits.u_" in out
    assert "\n    what would help: " in out
    certificate = certificate_of(tmp_path)
    assert not certificate.certified
    assert certificate.terminal is None


def test_a_run_whose_certificate_is_void_is_refused(capsys, tmp_path):
    assert run_in(tmp_path / "out", *NOT_CERTIFIED) == 1
    out, err = capsys.readouterr()
    assert out == ""
    last = err.splitlines()[-1]
    assert last.startswith("uvms-drake: error: ")
    assert ": --uncertified runs it with its declared tube, " in last
    assert "; not certified: tube in limits.u_" in last
    assert not (tmp_path / "out").exists()
    assert run_in(tmp_path / "out", *NOT_CERTIFIED, "--uncertified") == 0


def test_what_a_certificate_does_not_depend_on_can_change(committed, capsys):
    assert run_in(committed, "--seed", "5", "--set", "task.force_tolerance=3",
                  "--set", "tube.e=0.1", "--set", "mpc.terminal_radius=0.1") == 0
    assert "certifying" not in capsys.readouterr().err
    assert certificate_of(committed).made_by == "certify"
    record = load_record(committed)
    assert record.certified
    assert record.scenario.tube.e == certificate_of(committed).tube.e


def test_a_certificate_that_was_changed_by_hand_is_refused(committed, capsys):
    path = committed / "certificate.json"
    changed = path.read_text(encoding="utf-8").replace('"d_bound": 0.1', '"d_bound": 0.2')
    for text in (changed, "{}", "[]", "", path.read_text(encoding="utf-8")[:-20]):
        path.write_text(text, encoding="utf-8")
        assert run_in(committed) == 1
        out, err = capsys.readouterr()
        assert out == ""
        assert err.startswith(f"uvms-drake: error: {path}: its content does not match its SHA-256")
        assert err.count("\n") == 1
        assert written(committed) == {"certificate.json"}
        assert path.read_text(encoding="utf-8") == text


def test_a_stale_certificate_is_refused(committed, capsys):
    path = committed / "certificate.json"
    text = path.read_text(encoding="utf-8")
    assert run_in(committed, "--set", "disturbance.bound=0.09") == 1
    assert capsys.readouterr().err == (
        f"uvms-drake: error: {path}: stale, the scenario has changed since 'certify' made it; use "
        "another --output, or make it again: uvms-drake certify girona500_ideal --set "
        f"duration=0.1 --set disturbance.bound=0.09 --output {committed}\n")
    assert written(committed) == {"certificate.json"}
    assert path.read_text(encoding="utf-8") == text


def test_in_the_default_folder_a_new_certificate_takes_the_place_of_a_stale_one(
        certified, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["certify", "girona500_ideal"]) == 0
    capsys.readouterr()
    assert main(["run", "girona500_ideal", "--duration", "0.1", "--set", "disturbance.bound=0.09",
                 *DATA_ONLY]) == 0
    assert "the scenario has changed since 'certify' made it, a new one replaces it" in (
        capsys.readouterr().err)
    certificate = certificate_of(tmp_path / "out" / "girona500_ideal")
    assert (certificate.d_bound, certificate.made_by) == (0.09, "run")


def test_the_command_that_the_refusal_names_makes_the_certificate_again(
        certified, tmp_path, capsys):
    file, folder = tmp_path / "my wall.yaml", tmp_path / "my run"
    file.write_text(dump_scenario(load_scenario("girona500_ideal")), encoding="utf-8")
    assert main(["certify", str(file), "--output", str(folder)]) == 0
    args = [str(file), "--set", "disturbance=!RandomDisturbance {bound: 0.09, bandwidth: 2}"]
    assert run_in(folder, *args) == 1
    program, *words = shlex.split(capsys.readouterr().err.split(" make it again: ")[1])
    assert program == "uvms-drake"
    assert main(words) == 0
    assert run_in(folder, *args) == 0


def test_a_run_after_a_run_with_other_values_makes_a_certificate_of_its_own(
        certified, tmp_path, capsys):
    other = ["--set", "disturbance.bound=0.083"]
    for args, bound, computed in (([], 0.1, False), (other, 0.083, True), (other, 0.083, False)):
        assert run_in(tmp_path, *args) == 0
        assert ("certifying" in capsys.readouterr().err) == computed
        assert (certificate_of(tmp_path).d_bound, certificate_of(tmp_path).made_by) == (
            bound, "run")
        assert load_record(tmp_path).scenario.tube.e == certificate_of(tmp_path).tube.e


def test_a_changed_file_of_the_robot_is_noticed(capsys, tmp_path):
    robot, output = broken_robot(tmp_path, "", ""), tmp_path / "out"
    args = [*NOT_CERTIFIED, "--set", f"model={robot}"]
    assert main(["certify", "girona500_ideal", *args, "--output",
                 str(output)]) == 1  # not certified is enough for this
    capsys.readouterr()
    file = robot / "hydrodynamics.yaml"
    file.write_text(file.read_text(encoding="utf-8") + "# touched\n", encoding="utf-8")
    assert run_in(output, *args) == 1
    err = capsys.readouterr().err
    assert "certificate.json: stale, a file of the robot has changed" in err
    assert err.count("\n") == 1


def test_an_uncertified_run_takes_the_certificate_out_of_its_folder(certified, tmp_path, capsys):
    assert run_in(tmp_path) == 0
    assert run_in(tmp_path, "--uncertified") == 0
    assert written(tmp_path) == DATA
