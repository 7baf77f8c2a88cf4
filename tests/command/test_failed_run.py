"""Tests of a run that an exception ends: its data, its verdict, its status, what reads them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem
from support.outputs import DATA, written
from support.synthetic import synthetic_record

import uvms_drake as uv
from uvms_drake.campaign.campaign import make_campaign
from uvms_drake.campaign.failures import failures_of
from uvms_drake.campaign.run import run_one
from uvms_drake.certificate.run_verdict import FAILED
from uvms_drake.command.main import main
from uvms_drake.control.laws.resolved import Resolved
from uvms_drake.control.mpc.planner import Planner
from uvms_drake.plant.hydrodynamics import Hydrodynamics
from uvms_drake.sensing.force_sensor import ForceSensor
from uvms_drake.station.record import load_record
from uvms_drake.station.simulation import SIGNALS, finite_part

BEGIN = 0.25
SHORT = ["duration=0.5", "mpc.horizon=8", "mpc.time_step=0.1", "log_period=0.02"]
ERRORS = {"law": uv.InvalidParameter("rows", "x", "y"), "MPC": uv.RunFailed("no way on"),
          "sensor": ZeroDivisionError("a gain of zero"), "plant": SystemExit("condition failed")}
CAUSES = {"law": "rows = 'x': must be y", "MPC": "no way on", "plant": "(SystemExit, test_failed_",
          "sensor": "a gain of zero (ZeroDivisionError, test_failed_run.py, line "}


class Breaking(LeafSystem):
    """Passes a vector on, and raises an error from `BEGIN` on."""

    def __init__(self, size, error):
        super().__init__()
        self.DeclareVectorInputPort("in", size)
        self.DeclareVectorOutputPort("out", size, lambda context, output: (
            breaking(context.get_time(), error),
            output.SetFromVector(self.get_input_port().Eval(context))))


def breaking(now, error):
    if now >= BEGIN:
        raise error


@pytest.fixture
def break_in(monkeypatch):
    """Returns a function that makes one stage of a loop raise its error from `BEGIN` on."""
    def patch(stage, error):
        clock = [0.0]
        monkeypatch.setattr(  # A law does not know the time.
            Hydrodynamics, "_solve", lambda self, context, own=Hydrodynamics._solve: (
                clock.__setitem__(0, context.get_time()),
                breaking(context.get_time(), error) if stage == "plant" else None,
                own(self, context))[2])
        if stage == "law":
            monkeypatch.setattr(Resolved, "command", lambda *args, own=Resolved.command: (
                breaking(clock[0], error), own(*args))[1])
        if stage == "MPC":
            monkeypatch.setattr(Planner, "again", lambda self, sample, memory, own=Planner.again: (
                breaking(sample.time, error), own(self, sample, memory))[1])
        if stage == "sensor":
            def add_to(self, builder, model, port, signals, seed, own=ForceSensor.add_to):
                out = own(self, builder, model, port, signals, seed)
                broken = builder.AddSystem(Breaking(out.size(), error))
                builder.Connect(out, broken.get_input_port())
                return broken.get_output_port()

            monkeypatch.setattr(ForceSensor, "add_to", add_to)
    return patch


def run(folder, *more):
    return main(["run", "girona500_ideal", "--uncertified", "--quiet", "--output", str(folder),
                 "--set", "sensing=[!ForceSensor {}]",
                 *(f"--set={each}" for each in SHORT), *more])


@pytest.mark.parametrize("stage", ERRORS)
def test_what_was_simulated_until_an_exception_is_written_and_read_again(
        stage, break_in, tmp_path, capsys):
    break_in(stage, ERRORS[stage])
    assert run(tmp_path / "run", "--no-figures", "--no-replay") == FAILED == 4
    out, err = capsys.readouterr()
    assert "Traceback" not in err
    assert {*DATA} == written(tmp_path / "run")
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    text = summary["verdict"]["text"]
    assert text.startswith("FAILED at t = 0.") and CAUSES[stage] in text
    assert out.startswith(f"girona500_ideal: {text}\n") and out.splitlines()[-1] == text
    record = load_record(tmp_path / "run")
    assert BEGIN - 0.03 <= record.time[-1] <= 0.31  # The MPC breaks at its next sample, 0.3 s.
    assert summary["duration_s"] == record.time[-1] and record.scenario.duration == 0.5
    assert np.all(np.isfinite(record.u)) and len(record.u) == len(record.time) == len(record.force)
    lines = (tmp_path / "run" / "log.csv").read_text().splitlines()
    assert float(lines[-1].split(",")[0]) == pytest.approx(record.time[-1])


@pytest.mark.long
def test_figures_report_and_comparison_tell_the_failure(break_in, tmp_path, capsys):
    break_in("law", ERRORS["law"])
    assert run(tmp_path / "a", "--no-replay") == FAILED
    first = (tmp_path / "a" / "report.html").read_text()
    assert "<p class=\"verdict no\">FAILED at t = " in first
    assert main(["plot", str(tmp_path / "a")]) == 0
    assert (tmp_path / "a" / "report.html").read_text() == first
    assert main(["compare", str(tmp_path / "a"), str(tmp_path / "a"),
                 "--output", str(tmp_path / "b")]) == 0
    assert "| failed at [s]" in (tmp_path / "b" / "compare.md").read_text()


def test_a_campaign_counts_a_run_that_an_exception_ended(monkeypatch):
    record = synthetic_record(1.0, failure=np.array("at t = 1.000 s: no way on"))
    monkeypatch.setattr("uvms_drake.campaign.run.simulate", lambda scenario, certified: record)
    monkeypatch.setattr("uvms_drake.campaign.run.draw",
                        lambda campaign, index: (record.scenario, {}))
    result = run_one(make_campaign(record.scenario, 0, None), 0)
    assert result["error"] == "RunFailed: at t = 1.000 s: no way on"
    assert failures_of(result) == ("exception",)


def test_before_there_is_anything_to_write_nothing_is_written(monkeypatch, tmp_path, capsys):
    def command(*args):
        raise ERRORS["law"]

    monkeypatch.setattr(Resolved, "command", command)
    assert run(tmp_path / "run") == 2
    assert not (tmp_path / "run").exists()
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


def test_a_signal_that_is_no_number_any_more_ends_a_run_likewise(monkeypatch):
    own, calls = Resolved.command, []

    def command(*args):
        calls.append(1)
        found = own(*args)
        return found if len(calls) < 110 else replace(found, tau=np.nan * found.tau)

    monkeypatch.setattr(Resolved, "command", command)
    record = uv.simulate(uv.load_scenario("girona500_ideal", SHORT))
    assert str(record.failure).endswith("Detected NaN in applied generalized force input port.")
    assert 0.02 < record.time[-1] < 0.5 and np.all(np.isfinite(record.state))


def test_the_logs_end_before_the_first_signal_that_is_no_number():
    record = synthetic_record(2.0)
    logs = {name: getattr(record, name) for name in (
        *SIGNALS, "time", "mpc_time", "step_seconds", "tube_report")}
    assert finite_part(logs) == (logs, "")
    u, tau = record.u.copy(), record.tau.copy()
    u[60:, 2], tau[61, 0] = np.nan, np.inf
    cut, failure = finite_part(logs | {"u": u, "tau": tau})
    assert failure == "at t = 1.200 s: u is not finite"
    assert len(cut["time"]) == len(cut["state"]) == 60 and len(cut["tube_report"]) == 19
    assert len(cut["mpc_time"]) == len(cut["step_seconds"]) == 6 and cut["mpc_time"][-1] == 1.0
    u[1] = np.nan
    with pytest.raises(uv.RunFailed, match=r"at t = 0\.020 s: u is not finite"):
        finite_part(logs | {"u": u})
