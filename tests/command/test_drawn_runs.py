"""Tests of drawn runs: `certify --runs`, a `run` with its certificate, and `campaign`."""

import json
import shlex
import shutil
from dataclasses import replace

import pytest
from support.outputs import DATA, DATA_ONLY, written
from support.robots import copied

import uvms_drake as uv
from uvms_drake.certificate.certificate import fingerprint, read_certificate, write_certificate
from uvms_drake.command.main import main
from uvms_drake.tube.conditions import assumption

SHORT = ["girona500_ideal", "--set", "duration=0.4",
         "--set", "start.eta=[-1.13, -0.05, -0.05, 0.02, 0.02, 0.05]"]
CERTIFY = ["certify", *SHORT, "--runs", "2", "--seed", "3", "--workers", "1"]
VERDICT = ("certified in probability: at most 77.7 % per run at 95 % confidence, for the declared "
           "distribution")
OUTSIDE = ["--set", "current=[0.1, 0.0, 0.0]"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The folder of a certificate of two runs, which must not be changed."""
    folder = tmp_path_factory.mktemp("probability") / "out"
    assert main([*CERTIFY, "--quiet", "--output", str(folder)]) == 0
    return folder


@pytest.fixture
def kept(made, tmp_path, capsys):
    capsys.readouterr()
    return shutil.copytree(made, tmp_path / "out")


@pytest.mark.slow
def test_it_is_stored_as_a_campaign_and_says_what_it_is(made, tmp_path, capsys):
    assert written(made) == {"certificate.json", "runs"}
    assert {"setup.json", "runs.jsonl", "campaign.json"} <= written(made / "runs")
    certificate = read_certificate(made / "certificate.json")
    assert (certificate.runs, certificate.failures, certificate.made_by) == (2, 0, "certify")
    assert certificate.probability == pytest.approx(1.0 - 0.05**0.5)
    assert certificate.source == json.loads(
        (made / "runs" / "setup.json").read_text("utf-8"))["source"]
    capsys.readouterr()
    # A run of it is repeated as of any campaign.
    again = shutil.copytree(made, tmp_path / "out")
    assert main(["campaign", "--output", str(again / "runs"), "--replay", "1"]) == 0


@pytest.mark.slow
def test_an_interrupted_one_goes_on_to_the_same_certificate(kept, made, capsys):
    log = kept / "runs" / "runs.jsonl"
    first, second = log.read_bytes().splitlines(keepends=True)
    log.write_bytes(first + second[:40])
    (kept / "certificate.json").unlink()
    assert main([*CERTIFY, "--output", str(kept)]) == 0
    out, err = capsys.readouterr()
    assert "1 of 2 runs are there already" in err
    assert out.startswith(f"girona500_ideal: {VERDICT}\n\n0 of 2 runs failed.\n")
    assert (kept / "certificate.json").read_bytes() == (made / "certificate.json").read_bytes()
    # Runs that are there cannot be left out by asking for fewer.
    assert main([*CERTIFY, "--runs", "1", "--full", "--output", str(kept)]) == 0
    out, err = capsys.readouterr()
    assert "2 of 2 runs are there already" in err
    assert VERDICT in out
    assert "girona500_ideal, seed 3: 2 runs of 0.4 s" in out
    # More than chosen are none of this certificate: they would be asked for by the outcome.
    assert main([*CERTIFY, "--runs", "3", "--output", str(kept)]) == 2
    assert "--runs = 3: must be at most 2, the number that" in capsys.readouterr().err
    # Of another seed they are others'.
    assert main([*CERTIFY, "--seed", "4", "--output", str(kept)]) == 2
    assert "another campaign" in capsys.readouterr().err


@pytest.mark.slow
def test_a_run_takes_it_from_its_folder_and_says_its_kind(kept, capsys):
    command = ["run", *SHORT, "--output", str(kept), "--no-replay"]
    assert main(command) == 0
    out, err = capsys.readouterr()
    assert VERDICT in err
    assert out.splitlines()[-2:] == ["this run did not fail: tube and all limits kept", VERDICT]
    assert "declared tube (certified in probability)" in out
    assert "all guarantees kept" not in out
    summary = json.loads((kept / "summary.json").read_text("utf-8"))
    assert summary["in_probability"]["verdict"] == VERDICT
    assert summary["in_probability"]["outside"] == []
    assert summary["tube"]["certified"] is False
    for draw in ([], ["plot", str(kept)]):  # As it was drawn, and drawn again.
        assert not draw or main(draw) == 0
        text = (kept / "report.html").read_text("utf-8")
        assert VERDICT[1:] in text
        assert "all conditions hold" not in text
        assert "proven" not in text
        assert "Run without a certificate" not in text
    assert "<pre>uvms-drake run scenario.yaml</pre>" in text


@pytest.mark.slow
@pytest.mark.parametrize("override", ["ancillary.k=21", "current=[0.1, 0.0, 0.0]"])
def test_one_of_another_scenario_is_stale(override, kept, capsys):
    """Two distributions are the same if their scenarios are."""
    assert main(["run", *SHORT, "--set", override, "--output", str(kept)]) == 1
    err = capsys.readouterr().err
    assert "stale, the scenario has changed since 'certify' made it" in err
    assert "--runs 2 --seed 3, in a new folder" in err


@pytest.mark.slow
def test_a_run_elsewhere_finds_it_where_no_worst_case_certificate_holds(
        made, tmp_path, capsys, monkeypatch):
    def not_certified(scenario, progress=None, model=None):
        return uv.Certificate(
            scenario=scenario.name, law="resolved", k=1.0, sigma=1.0, d_bound=0.1,
            conditions=(assumption("thrusters", "delay", theorem="actuation"),),
            **fingerprint(scenario))

    monkeypatch.setattr("uvms_drake.certificate.certify.certified_once", not_certified)
    command = ["run", *SHORT, "--output", str(tmp_path), *DATA_ONLY]
    assert main([*command, "--seed", "5"]) == 0
    assert VERDICT in capsys.readouterr().out
    assert written(tmp_path) == DATA | {"certificate.json"}
    assert read_certificate(tmp_path / "certificate.json").made_by == "run"
    # One that nobody has made is not found.
    assert main(["run", *SHORT, *OUTSIDE, "--output", str(tmp_path / "other"), *DATA_ONLY]) == 1
    assert "'certify --runs N' bounds the probability" in capsys.readouterr().err


@pytest.mark.slow
def test_a_run_that_fails_is_counted(tmp_path, capsys):
    """The declared tube is left by any motion at all."""
    narrow = shlex.split("--set tube.z=1e-7 --confidence 0.9")
    assert main([*CERTIFY, *narrow, "--quiet", "--output", str(tmp_path)]) == 3
    out = capsys.readouterr().out
    assert "2 of 2 runs failed (0, 1): 2 left the declared tube." in out
    assert out.startswith("girona500_ideal: not certified in probability: every run failed\n")
    certificate = read_certificate(tmp_path / "certificate.json")
    assert (certificate.failures, certificate.probability) == (2, 1.0)
    # It is no certificate to run with; with one that bounds failures, those of a run are told.
    run = ["run", *SHORT, "--set", "tube.z=1e-7", "--output", str(tmp_path), *DATA_ONLY]
    assert main(run) == 1
    assert "not certified in probability: every run failed" in capsys.readouterr().err
    write_certificate(replace(certificate, runs=3, probability=0.9), tmp_path)
    assert main(run) == 3
    assert "this run FAILED: the tube, set-wise" in capsys.readouterr().out


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
    assert main(["scenario", "--uncertified", "--new", str(file), "--robot", str(robot),
                 "--force", "10"]) == 0

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
        main(["campaign", "girona500_contact", "--uncertified", "--output", str(tmp_path)])
    assert "goes on with the others" in error.value.__notes__[0]
    assert not (tmp_path / "campaign.json").exists()
