"""Tests of drawn runs: `certify --runs`, a `run` with its certificate, and `campaign`."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from support.outputs import DATA, DATA_ONLY, written
from support.refusals import refusals
from support.robots import copied

import uvms_drake as uv
from uvms_drake.certificate.attempts import ledger_path
from uvms_drake.certificate.certificate import fingerprint, read_certificate, write_certificate
from uvms_drake.certificate.in_probability import failure_bound, percent_above, spent
from uvms_drake.command.drawn_runs import drawable
from uvms_drake.command.main import main
from uvms_drake.tube.conditions import assumption

SHORT = ["girona500_bilateral", "--set", "duration=0.4", "--set", "task.force=[4, 0, 0, 0, 0, 0]",
         "--set", "disturbance.bound=0.05",
         "--set", f"surface.stiffness={np.diag([100.0, 40.0, 40.0, 0.5, 0.5, 0.5]).tolist()}"]
"""In contact from the start, with a spring so soft that most starts are accepted, and half of the
disturbance that the tube is for: the seed is another with every change of the package."""
CERTIFY = ["certify", *SHORT, "--runs", "2", "--workers", "1"]
VERDICT = ("certified in probability: at most 84.2 % per run at 95 % confidence over all attempts "
           "(attempt 1), for the declared distribution")
OUTSIDE = ["--set", "current=[0.1, 0.0, 0.0]"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The folder of a certificate of two runs, beside its cache; they must not be changed."""
    folder = tmp_path_factory.mktemp("probability") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder.parent / "cache"))
        assert main([*CERTIFY, "--quiet", "--output", str(folder)]) == 0
    return folder


@pytest.fixture
def kept(made, tmp_path, capsys, monkeypatch):
    """A copy of it, with a ledger of its own."""
    shutil.copytree(made.parent / "cache", tmp_path / "cache")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    capsys.readouterr()
    return shutil.copytree(made, tmp_path / "out")


def test_the_help_says_what_20_60_and_300_runs_give(capsys):
    with pytest.raises(SystemExit):
        main(["certify", "--help"])
    said = " ".join(capsys.readouterr().out.split())
    bounds = [percent_above(failure_bound(runs, 0, spent(0.95, 1))) for runs in (20, 60, 300)]
    assert bounds == ["16.9 %", "5.97 %", "1.23 %"]
    assert "20 runs bound it by 16.9 % at the first attempt, 60 by 6.0 %, 300 by 1.3 %" in said


@pytest.mark.slow
def test_it_is_stored_as_a_campaign_and_says_what_it_is(made):
    assert written(made) == {"certificate.json", "runs"}
    assert {"setup.json", "runs.jsonl", "campaign.json"} <= written(made / "runs")
    certificate = read_certificate(made / "certificate.json")
    assert (certificate.runs, certificate.failures, certificate.made_by) == (2, 0, "certify")
    assert certificate.probability == pytest.approx(1.0 - 0.025**0.5)
    assert set(certificate.use) > {"position", "nu1", "roll", "pitch", "u_surge", "u_q4"}
    assert 0.0 < max(certificate.use.values()) < 1.0
    (attempt,) = certificate.attempts
    assert (attempt.task, attempt.runs) == ("girona500_arm5e, KnownSurface, press", 2)
    assert attempt.seed == json.loads((made / "runs" / "setup.json").read_text("utf-8"))["seed"]
    assert certificate.source == json.loads(
        (made / "runs" / "setup.json").read_text("utf-8"))["source"]


@pytest.mark.long
def test_a_run_of_it_is_repeated_as_of_any_campaign(made, tmp_path):
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
    assert "attempt 1 at: girona500_arm5e, KnownSurface, press; in " in err
    assert out.startswith(f"girona500_bilateral: {VERDICT}\n\nruns          0 of 2 failed\n"
                          "attempt       1 at: ")
    assert out.count("\n") < 12 and " s a run in the median, by the clock, " in out
    assert (kept / "certificate.json").read_bytes() == (made / "certificate.json").read_bytes()
    # Runs that are there cannot be left out by asking for fewer, nor added to by their outcome.
    for number in ("1", "3"):
        assert main([*CERTIFY, "--runs", number, "--output", str(kept)]) == 2
        assert "another campaign" in capsys.readouterr().err
    # A refused command is no attempt.
    assert len(ledger_path().read_text("utf-8").splitlines()) == 1
    assert main([*CERTIFY, "--seed", "4", "--output", str(kept)]) == 2
    assert "unrecognized arguments: --seed 4" in capsys.readouterr().err


@pytest.mark.slow
def test_neither_folder_nor_seed_nor_the_smallest_change_makes_another_first_attempt(
        kept, made, tmp_path, capsys):
    """A folder changes nothing; a limit by 1e-9 other draws, and the number of the attempt."""
    elsewhere, changed = tmp_path / "elsewhere", tmp_path / "changed"
    assert main([*CERTIFY, "--output", str(elsewhere)]) == 0
    assert VERDICT in capsys.readouterr().out
    for name in ("certificate.json", "runs/campaign.json"):
        assert (elsewhere / name).read_bytes() == (made / name).read_bytes()
    assert main([*CERTIFY, "--set", "seed=4", "--output", str(tmp_path / "seed")]) == 2
    assert main([*CERTIFY, "--set", "limits.nu1=0.250000001", "--output", str(changed)]) == 0
    assert "(attempt 2)" in capsys.readouterr().out
    first, second = (read_certificate(each / "certificate.json") for each in (kept, changed))
    assert second.attempts[:1] == first.attempts
    assert second.probability == pytest.approx(1.0 - (0.05 / 6.0)**0.5)
    starts = [json.loads((each / "runs" / "campaign.json").read_text("utf-8"))["results"][0]["eta"]
              for each in (elsewhere, changed)]
    assert starts[0] != starts[1]


@pytest.mark.slow
def test_an_attempt_is_in_the_ledger_before_its_first_run(tmp_path, capsys, monkeypatch):
    """So an interrupted one counts, and none is made where it cannot be written down."""
    def interrupted(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr("uvms_drake.campaign.harness.run_all", interrupted)
    for gains, number in ((["ancillary.k=21"], 1), ([], 2), (["ancillary.k=21"], 1)):
        sets = [part for each in gains for part in ("--set", each)]
        with pytest.raises(KeyboardInterrupt):
            main([*CERTIFY, *sets, "--output", str(tmp_path / f"out{number}")])
        assert (f"attempt {number} at: girona500_arm5e, KnownSurface, press"
                in capsys.readouterr().err)
    ledger_path().write_text("[]\n")
    assert main([*CERTIFY, "--output", str(tmp_path / "out")]) == 1
    assert "line 1 is none of a ledger" in capsys.readouterr().err
    ledger_path().unlink()
    ledger_path().mkdir()
    assert main([*CERTIFY, "--output", str(tmp_path / "out")]) == 1
    assert "the ledger of attempts has to be kept" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("radius", ["pitch=0", "nu1=null"])
def test_a_radius_that_tightens_a_limit_has_to_be_declared(radius, tmp_path, capsys):
    assert main([*CERTIFY, "--set", f"tube.{radius}", "--output", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert f"tube.{radius.partition('=')[0]} = " in err and "watches each radius" in err


@pytest.mark.long
def test_a_run_takes_it_from_its_folder_and_says_its_kind(kept, capsys):
    command = ["run", *SHORT, "--output", str(kept), "--no-replay"]
    assert main(command) == 0
    out, err = capsys.readouterr()
    assert VERDICT in err
    assert out.splitlines()[-1] == f"this run did not fail: tube and all limits kept; {VERDICT}"
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
    assert "--runs 2, in a new folder" in err


@pytest.mark.slow
def test_a_run_elsewhere_finds_it_where_no_worst_case_certificate_holds(
        made, tmp_path, capsys, monkeypatch):
    def not_certified(scenario, progress=None, model=None):
        return uv.Certificate(
            scenario=scenario.name, law="resolved", k=1.0, sigma=1.0, d_bound=0.1,
            conditions=(assumption("thrusters", "delay", theorem="actuation"),),
            **fingerprint(scenario))

    monkeypatch.setenv("XDG_CACHE_HOME", str(made.parent / "cache"))
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
@pytest.mark.parametrize("radius", ["tube.z=1e-7", "tube.roll=1e-9"])
def test_a_run_that_fails_is_counted(radius, tmp_path, capsys):
    """A tube of no size is left by any motion at all, also a row that no monitor watches."""
    narrow = ["--set", radius, "--confidence", "0.9"]
    assert main([*CERTIFY, *narrow, "--quiet", "--output", str(tmp_path)]) == 3
    out = capsys.readouterr().out
    assert "2 of 2 failed (0, 1): 2 left the declared tube in any of its radii\n" in out
    assert out.startswith("girona500_bilateral: not certified in probability: every run failed\n")
    certificate = read_certificate(tmp_path / "certificate.json")
    assert (certificate.failures, certificate.probability) == (2, 1.0)
    # It is no certificate to run with; with one that bounds failures, those of a run are told.
    run = ["run", *SHORT, "--set", radius, "--output", str(tmp_path), *DATA_ONLY]
    assert main(run) == 1
    assert "not certified in probability: every run failed" in capsys.readouterr().err
    write_certificate(replace(certificate, runs=3, probability=0.9), tmp_path)
    assert main(run) == 3
    assert ("this run FAILED: the tube, set-wise" if "z" in radius else
            "this run FAILED: it left the declared tube in any of its radii"
            ) in capsys.readouterr().out


test_what_cannot_be_drawn_is_refused_before_an_attempt = refusals("girona500_real_loop", {
    "draws.force=[1, 20]": r"task\.force_tolerance = 2\.0: must be below 1 N",
    "draws.joints=[0.1, 0.1]": r"draws\.joints",
    "actuation.1.error=[-1]": "an error of -1",
    "mpc.deadline=0.1": r"mpc\.deadline",
}, drawable)


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
