"""Campaigns: what is drawn is inside the bounds, and no worker, order or accident changes it."""

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RotationMatrix
from support.true_model import model_with_error
from support.workers import process_id

from uvms_drake.campaign.campaign import Campaign, Target, make_campaign
from uvms_drake.campaign.figures import CAMPAIGN_FIGURES, make_campaign_figures
from uvms_drake.campaign.outside import kinds_outside
from uvms_drake.campaign.pool import ONE_THREAD, RUNS_PER_WORKER, Pool, local_pool, run_all
from uvms_drake.campaign.run import run_one
from uvms_drake.campaign.store import RUNS_FILE, SETUP_FILE, read_setup, run_log
from uvms_drake.campaign.summary import (
    all_well,
    distribution,
    format_campaign,
    summarise_campaign,
    summarise_times,
)
from uvms_drake.campaign.unknowns import SHARE
from uvms_drake.campaign.vary import POSE_REACH, SHIFT_REACH, vary
from uvms_drake.campaign.walls import OTHER_WALLS, moved
from uvms_drake.certificate.certify import certified_once, certify
from uvms_drake.command.campaign import replayed
from uvms_drake.command.main import main
from uvms_drake.common.errors import InvalidParameter, RunFailed
from uvms_drake.common.output import MANIFEST_FILE
from uvms_drake.control.solver_faults import DroppedPeriod, SolverFailure, SolverTimeout
from uvms_drake.model.surface.law import check_surface
from uvms_drake.plant.adversary import AdversarialDisturbance
from uvms_drake.report.summary import summarise
from uvms_drake.station.diagram import MONITOR_SLACK
from uvms_drake.station.motions import make_ocp
from uvms_drake.station.problem import start_state
from uvms_drake.station.scenario import dump_scenario, load_scenario
from uvms_drake.station.simulation import simulate

RUNS = 6
CLOSE = ["--set", "start.eta=[-1.13, -0.05, -0.05, 0.02, 0.02, 0.05]"]
"""The tip starts a few centimetres off the wall, so that even a short run makes contact."""
SHORT = ["campaign", "--uncertified", "--set", "duration=0.6", *CLOSE, "--seed", "3"]


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    scenario = load_scenario("girona500_contact", ["duration=0.6", CLOSE[1]])
    return make_campaign(scenario, 3, None)


@pytest.fixture(scope="module")
def reference(tmp_path_factory) -> Path:
    """The folder of a campaign of one worker that nothing happened to."""
    folder = tmp_path_factory.mktemp("campaign") / "one"
    assert main([*SHORT, "--runs", str(RUNS), "--workers", "1", "--output", str(folder)]) == 0
    return folder


def result_bytes(folder: Path) -> bytes:
    return (folder / "campaign.json").read_bytes()


def indices_in(folder: Path) -> list[int]:
    lines = (folder / RUNS_FILE).read_text(encoding="utf-8").splitlines()
    return [json.loads(line)["result"]["index"] for line in lines]


def test_what_is_drawn_is_a_function_of_seed_and_index(campaign):
    def text(campaign, index):
        return dump_scenario(vary(campaign, index).scenario)

    assert text(campaign, 4) == text(campaign, 4)
    assert text(campaign, 4) != text(campaign, 5)
    assert text(campaign, 4) != text(replace(campaign, seed=4), 4)


def test_what_is_drawn_is_inside_the_bounds_and_comes_in_all_kinds(campaign):
    base = campaign.base
    kinds, faults = set(), set()
    for index in range(25):
        scenario, outside = vary(campaign, index)
        start_state(scenario, make_ocp(scenario))  # raises outside of the nominal limits
        yaw = np.arctan2(*-scenario.surface.normal[1::-1])
        start = moved(base, yaw, scenario.surface.point).start
        assert np.all(np.abs(scenario.start.eta - start.eta) <= POSE_REACH)
        assert np.all(np.abs(scenario.surface.point) <= SHIFT_REACH)
        assert scenario.disturbance.bound == base.disturbance.bound
        assert outside is None
        kinds.add(getattr(scenario.disturbance, "kind", type(scenario.disturbance).__name__))
        faults |= {type(fault) for fault in scenario.faults}
    assert len(kinds) > 6
    assert faults <= {SolverFailure, SolverTimeout, DroppedPeriod}
    assert len(faults) > 1


def test_a_scenario_with_an_adversary_goes_through_a_file(campaign, tmp_path):
    drawn = (vary(campaign, index).scenario for index in range(20))
    aimed = next(scenario for scenario in drawn
                 if isinstance(scenario.disturbance, AdversarialDisturbance))
    file = tmp_path / "aimed.yaml"
    file.write_text(dump_scenario(aimed), encoding="utf-8")
    assert dump_scenario(load_scenario(str(file))) == dump_scenario(aimed)


def test_another_desired_force_has_the_terminal_set_of_its_own(campaign):
    other = replace(campaign, targets=(Target(None, 0.8, 0.3),))
    scenario = vary(other, 0).scenario
    assert np.linalg.norm(scenario.task.force) == pytest.approx(
        0.8 * np.linalg.norm(campaign.base.task.force))
    assert scenario.mpc.terminal_radius == 0.3


def test_a_base_that_cannot_be_used_says_so(campaign):
    text = campaign.scenario.replace("force: [20.0", "force: [900.0")
    with pytest.raises(InvalidParameter, match=r"task\.force.*limits\.static_force"):
        vary(replace(campaign, scenario=text), 0)


def test_a_run_that_raises_is_a_result(campaign, monkeypatch):
    def breaks(scenario):
        raise ZeroDivisionError("of\nno use")

    monkeypatch.setattr("uvms_drake.campaign.run.simulate", breaks)
    run = run_one(campaign, 2)
    assert run["result"]["error"] == "ZeroDivisionError: of no use"
    assert run["result"]["index"] == 2
    summary = summarise_campaign(campaign, [run["result"]])
    assert summary["counts"]["exceptions"] == 1
    assert not all_well(summary)
    assert "exceptions: 1" in format_campaign(summary, summarise_times([run["wall"]]), "DIR")


def test_the_workers_take_one_core_each_and_the_parent_is_left_as_it_was(monkeypatch):
    monkeypatch.setenv(ONE_THREAD[0], "7")
    with local_pool(1).open() as executor:
        assert executor.submit(os.getenv, ONE_THREAD[0]).result() == "1"
    assert os.environ[ONE_THREAD[0]] == "7"


def test_a_worker_is_replaced_before_it_keeps_too_much_memory(monkeypatch):
    monkeypatch.setattr("uvms_drake.campaign.pool.run_one", process_id)
    monkeypatch.setattr("uvms_drake.campaign.pool.RUNS_PER_WORKER", 3)
    runs = dict(run_all(None, range(7), local_pool(1)))
    assert list(runs) == list(range(7))
    processes = [runs[index]["process"] for index in range(7)]
    assert [len(set(processes[i: i + 3])) for i in (0, 3, 6)] == [1, 1, 1]
    assert len(set(processes)) == 3
    assert RUNS_PER_WORKER * 7 < 300  # MB: a run leaves 6 MB behind.


def test_the_distribution_tells_whose_the_worst_is():
    results = [{"index": i, "margin": value, "force_error": value}
               for i, value in ((4, 0.3), (7, 0.1), (9, None), (2, 0.2))]
    assert distribution(results, "margin")["worst"] == 7
    assert distribution(results, "force_error") == {
        "count": 3, "min": 0.1, "median": 0.2, "p95": pytest.approx(0.29), "max": 0.3, "worst": 4}
    assert distribution([], "margin")["worst"] is None


def test_all_files_are_there(reference):
    assert {path.name for path in reference.iterdir()} == {
        SETUP_FILE, RUNS_FILE, MANIFEST_FILE, "campaign.json", "timing.json", *CAMPAIGN_FIGURES}
    data = json.loads(result_bytes(reference))
    assert [result["index"] for result in data["results"]] == list(range(RUNS))
    assert data["counts"]["exceptions"] == data["counts"]["exits_trajectory"] == 0
    assert "seconds" not in result_bytes(reference).decode()
    timing = json.loads((reference / "timing.json").read_text())
    assert timing["seconds"]["median"] > 0.0
    assert sum(timing["steps"]) == RUNS * 3  # 0.6 s, a plan every 0.2 s
    assert 0.1 < timing["step_ms"]["p50"] <= timing["step_ms"]["p99"]


def test_two_workers_give_the_same_bytes(reference, tmp_path):
    assert main([*SHORT, "--runs", str(RUNS), "--workers", "2", "--output", str(tmp_path)]) == 0
    assert result_bytes(tmp_path) == result_bytes(reference)


def test_a_campaign_goes_on_and_can_be_made_longer(reference, tmp_path, capsys):
    """Also if the last line was cut off and another one is damaged."""
    assert main([*SHORT, "--runs", "3", "--workers", "1", "--output", str(tmp_path)]) == 0
    file = tmp_path / RUNS_FILE
    first, *rest = file.read_bytes().splitlines(keepends=True)
    file.write_bytes(b'{"result": 7}\n' + b"".join(rest) + first[: len(first) // 2])
    capsys.readouterr()
    assert main([*SHORT, "--runs", str(RUNS), "--workers", "1", "--output", str(tmp_path)]) == 0
    out, err = capsys.readouterr()
    assert f"2 of {RUNS} runs are there already" in err
    *_, files, verdict = out.splitlines()
    assert files.startswith(f"written to {tmp_path}: campaign.json, ")
    assert RUNS_FILE in files
    assert verdict == f"all promises kept; the force never settled in {RUNS} of {RUNS} runs"
    assert result_bytes(tmp_path) == result_bytes(reference)
    assert len(file.read_bytes().splitlines()) == RUNS + 1  # no run is there twice


def start(folder: Path, runs: int) -> subprocess.Popen:
    """Starts a campaign with two workers and returns it when the first run is done."""
    process = subprocess.Popen(
        [sys.executable, "-m", "uvms_drake", *SHORT, "--runs", str(runs), "--workers", "2",
         "--output", str(folder)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    wait_for(lambda: (folder / RUNS_FILE).is_file() and (folder / RUNS_FILE).stat().st_size > 0)
    return process


def wait_for(condition, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def workers_of(process: subprocess.Popen) -> list[int]:
    """Returns the process ids of a campaign's workers, as Linux tells."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    return [int(child) for child in children
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


linux = pytest.mark.skipif(sys.platform != "linux", reason="looks for the workers in /proc")


@linux
def test_killed_half_way_it_goes_on_and_leaves_no_worker(reference, tmp_path):
    process = start(tmp_path, RUNS)
    workers = workers_of(process)
    assert workers
    process.kill()
    process.communicate()
    wait_for(lambda: not any(Path(f"/proc/{worker}").exists() for worker in workers))
    assert main([*SHORT, "--runs", str(RUNS), "--workers", "2", "--output", str(tmp_path)]) == 0
    assert result_bytes(tmp_path) == result_bytes(reference)
    assert sorted(indices_in(tmp_path)) == list(range(RUNS))


@linux
def test_a_killed_worker_is_replaced(reference, tmp_path):
    process = start(tmp_path, RUNS)
    os.kill(workers_of(process)[0], signal.SIGKILL)
    _, errors = process.communicate(timeout=90)
    assert process.returncode == 0, errors
    assert result_bytes(tmp_path) == result_bytes(reference)
    assert sorted(indices_in(tmp_path)) == list(range(RUNS))


@linux
def test_an_interrupt_is_one_line_and_keeps_what_is_done(tmp_path):
    process = start(tmp_path, 50)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "Traceback" not in errors
    assert "goes on with the others" in errors.splitlines()[-1]
    assert not (tmp_path / "campaign.json").exists()
    assert indices_in(tmp_path)


def test_workers_that_always_die_are_given_up(campaign):
    class Dying(Executor):
        def submit(self, fn, /, *args, **kwargs):
            future: Future = Future()
            future.set_exception(OSError("gone"))
            return future

    @contextmanager
    def pool():
        yield Dying()

    with pytest.raises(RunFailed, match=r"die before any run comes back \(of 2 runs: 0, 1\): gone"):
        list(run_all(campaign, [0, 1], Pool(pool)))


def refusal(capsys, *args) -> str:
    """Runs with bad input and returns the only line on stderr."""
    assert main([*SHORT, *args]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err


def test_the_folder_of_another_campaign_is_refused(reference, capsys):
    before = result_bytes(reference), (reference / RUNS_FILE).read_bytes()
    err = refusal(capsys, "--seed", "4", "--output", str(reference))
    assert "another campaign" in err
    assert (result_bytes(reference), (reference / RUNS_FILE).read_bytes()) == before


def test_the_folder_is_looked_at_before_anything_is_certified(reference, capsys, monkeypatch):
    def certify(*args, **kwargs):
        pytest.fail("a certificate was begun")

    monkeypatch.setattr("uvms_drake.command.campaign.certified_once", certify)
    assert main(["campaign", "--seed", "3", "--output", str(reference)]) == 2
    assert "another campaign" in capsys.readouterr().err


def test_a_folder_in_use_is_refused(campaign, tmp_path, capsys):
    with run_log(tmp_path, campaign):
        assert "no other process" in refusal(
            capsys, "--model-error", "0", "--output", str(tmp_path))


def test_what_an_error_of_the_model_induces_is_what_the_plant_does():
    """Held against differences of its velocity, and M⁻¹(τ − n) − M̂⁻¹(τ − n̂) by both models."""
    scenario = load_scenario("girona500_contact", [
        "duration=1.0", CLOSE[1], "model_error.added_mass=1.2", "model_error.drag=0.8",
        "model_error.buoyancy_lever=1.1", "model_error.mass=1.02", "simulator.max_step_size=0.002",
        "log_period=0.002"])
    record = simulate(scenario)

    def acceleration(error):
        model = model_with_error(scenario.model, check_surface(scenario.surface), error)
        kinematics = model.kinematics(record.config)
        bias = model.inverse_dynamics(kinematics, record.zeta, np.zeros_like(record.zeta))
        return np.linalg.solve(
            model.mass_matrix(kinematics), (record.tau - bias)[..., None])[..., 0]

    believed = acceleration(None)
    induced = acceleration(scenario.model_error) - believed
    assert np.max(np.linalg.norm(induced, axis=1)) > 0.02
    np.testing.assert_allclose(
        record.effective_disturbance, record.disturbance + induced, atol=1e-8)
    true = np.gradient(record.zeta, record.time, axis=0)
    smooth = slice(1, 90)  # A plan ends at 0.2 s.
    np.testing.assert_allclose(
        true[smooth], (believed + record.effective_disturbance)[smooth], atol=2e-3)


def test_what_is_unknown_is_as_large_as_the_bound_covers(campaign):
    """Predicted before a run, measured in it, and large enough to matter."""
    off = replace(campaign, model_error=0.2)
    results = [run_one(off, index)["result"] for index in range(12)]
    summary = summarise_campaign(off, results)
    assert all_well(summary), summary["counts"]
    shared = [result for result in results if any(result["unknown"].values())]
    assert 3 <= len(shared) <= 9
    assert all(result["worst_disturbance"] <= 1.0 for result in shared)
    assert all(result["induced"] <= SHARE for result in shared)
    assert max(result["induced"] for result in shared) > 0.2
    assert all(result["induced"] < 1e-6 for result in results if result not in shared)
    assert "largest errors: " in format_campaign(summary, summarise_times([]), "DIR")


def test_outside_of_the_bounds_every_promise_is_kept(campaign):
    """Everything that can happen happens once; what leaves its bound is in the log."""
    kinds = kinds_outside(campaign.base)
    beyond = replace(campaign, outside=True, model_error=0.2,
                     scenario=campaign.scenario.replace("duration: 0.6", "duration: 1.6"))
    results = [run_one(beyond, index)["result"] for index in range(len(kinds))]
    assert [result["outside"] for result in results] == list(kinds)
    summary = summarise_campaign(beyond, results)
    assert all_well(summary), summary["counts"]
    by_kind = dict(zip(kinds, results, strict=True))
    assert "state_lost" in by_kind["state lost"]["noted"]
    assert by_kind["d of 5 bounds"]["worst_disturbance"] == pytest.approx(5.0, rel=1e-3)
    assert by_kind["state frozen"]["exits_set"] > 0
    for result in results:
        assert ("tube_left" in result["noted"]) == (result["exits_set"] > 0)
        assert ("disturbance_exceeded" in result["noted"]) != result["inside"]
    assert sum(result["worst_disturbance"] > 1.0 for result in results) > 5
    for kind in kinds:
        assert kind in format_campaign(summary, summarise_times([]), "DIR")


def test_a_promise_that_is_not_kept_is_told(campaign):
    result = run_one(campaign, 0)["result"]
    beyond = replace(campaign, outside=True)
    assert all_well(summarise_campaign(beyond, [result]))
    assert all_well(summarise_campaign(beyond, [result | {"exits_set": 1, "violations": 2}]))
    assert not all_well(summarise_campaign(campaign, [result | {"exits_set": 1}]))
    for broken in ({"proportional": False}, {"finite": False}, {"logged": False},
                   {"error": "ValueError: x"}):
        worse = [*(result | {"index": i, "ratio_set": 5.0} for i in range(1, 20)), result | broken]
        summary = summarise_campaign(beyond, worse)
        assert not all_well(summary), broken
        assert summary["worst"][0]["index"] == result["index"]
    for broken in ({"limited": True}, {"violations": 1}, {"exits_trajectory": 2}):
        summary = summarise_campaign(campaign, [result | {"index": 7}, result | broken])
        assert not all_well(summary), broken
        assert summary["worst"][0]["index"] == result["index"]


def test_runs_that_are_not_covered_are_told_and_few(campaign):
    result = run_one(campaign, 0)["result"]
    left = result | {"index": 1, "inside": False, "exits_set": 3}
    summary = summarise_campaign(campaign, [left, *(result | {"index": i} for i in range(2, 40))])
    assert all_well(summary)
    assert summary["counts"]["exits_set"] == 0
    assert "counted 38 of 39 runs" in format_campaign(summary, summarise_times([]), "DIR")
    assert summary["worst"][0]["index"] != 1
    assert not all_well(summarise_campaign(campaign, [left, result]))


def test_figures_of_runs_that_all_end_alike(campaign, tmp_path):
    """Without contact the force error at the end is the same in all but rounding."""
    run = run_one(campaign, 0)
    results = [run["result"] | {"index": i, "force_error": 20.0 + 4e-15 * i,
                                "settling_time_s": None} for i in range(3)]
    summary = summarise_campaign(campaign, results)
    paths = make_campaign_figures(summary, summarise_times([run["wall"]]), tmp_path)
    assert {path.name for path in paths} == set(CAMPAIGN_FIGURES)
    assert all(path.stat().st_size > 5000 for path in paths)


def test_another_program_runs_nothing(campaign, reference, monkeypatch, capsys):
    with pytest.raises(RunFailed, match="this package is not as it was"):
        run_one(replace(campaign, source="0" * 64), 0)
    with pytest.raises(RunFailed, match="a version is not"):
        run_one(replace(campaign, versions={"drake": "0.1"}), 0)
    monkeypatch.setattr("uvms_drake.campaign.campaign.source_digest", lambda: "1" * 64)
    assert main(["campaign", "--output", str(reference), "--replay", "2"]) == 1
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("runs", [None, 2])
def test_a_run_that_takes_its_worker_with_it_comes_last_and_is_named(campaign, runs):
    """The others are done, although it is the first."""
    class Poisoned(Executor):
        def __init__(self):
            self.dead = False

        def submit(self, fn, /, *args, **kwargs):
            future: Future = Future()
            self.dead = self.dead or args[1] == 0
            if self.dead:
                future.set_exception(OSError("gone"))
            else:
                future.set_result(args[1])
            return future

    @contextmanager
    def pool():
        yield Poisoned()

    runs = run_all(campaign, range(5), Pool(pool, runs))
    assert {next(runs)[0] for _ in range(4)} == {1, 2, 3, 4}
    with pytest.raises(RunFailed, match=r"of 1 runs: 0\)"):
        next(runs)


def test_another_place_makes_no_difference():
    """Rotated and translated, the same run: forces turn along, deviations do not change."""
    scenario = load_scenario("girona500_contact", [
        "duration=1.2", CLOSE[1], "current=[0.02, 0.01, 0]", "surface_error.stiffness=1.02",
        "surface_error.shift=[0.001, 0, 0]", "surface_error.turn=[0, 0.01, 0.01]"])
    yaw = 2.2
    here, there = simulate(scenario), simulate(moved(scenario, yaw, np.array([3.0, -8.0, 5.0])))
    assert np.max(here.penetration) > 0.002
    R = RotationMatrix.MakeZRotation(yaw).matrix()
    np.testing.assert_allclose(there.force[:, :3], here.force[:, :3] @ R.T, atol=2e-4)
    np.testing.assert_allclose(there.tube_deviation, here.tube_deviation, atol=1e-6)
    np.testing.assert_allclose(there.u, here.u, atol=1e-4)


def test_another_place_of_a_spring_makes_no_difference():
    scenario = load_scenario("girona500_bilateral", ["duration=0.4"])
    yaw = -1.3
    here, there = simulate(scenario), simulate(moved(scenario, yaw, np.array([1.0, 2.0, -3.0])))
    R = RotationMatrix.MakeZRotation(yaw).matrix()
    np.testing.assert_allclose(there.force[:, :3], here.force[:, :3] @ R.T, atol=2e-4)
    np.testing.assert_allclose(there.force[:, 3:], here.force[:, 3:], atol=2e-4)
    np.testing.assert_allclose(there.tube_deviation, here.tube_deviation, atol=1e-6)


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


def test_a_run_can_be_replayed_alone(reference, capsys, monkeypatch):
    result = json.loads(result_bytes(reference))["results"][2]
    record = replayed(reference, 2)
    assert np.linalg.norm(record.force[-1] - record.scenario.task.force) == pytest.approx(
        result["force_error"], rel=1e-12)
    assert read_setup(reference).seed == 3
    assert main(["campaign", "--output", str(reference), "--replay", "2"]) == 0
    assert (reference / "run-2" / "scenario.yaml").is_file()
    assert (reference / "run-2" / "force.png").is_file()
    capsys.readouterr()
    monkeypatch.chdir(reference)  # There is no out/girona500_contact-campaign.
    assert main(["campaign", "--replay", "2"]) == 2
    assert main(["campaign", "--replay", "2", "--output", str(reference / "run-2")]) == 2
    assert main(["campaign", "--replay", str(RUNS), "--output", str(reference)]) == 2
    assert capsys.readouterr().err.count("\n") == 3


@pytest.mark.parametrize(("args", "said"), [
    (["--runs", "5"], "--runs = 5"), (["--seed", "4"], "--seed = 4"),
    (["--workers", "1"], "--workers = 1"), (["--scheduler", "tcp://x:1"], "--scheduler = 'tcp:"),
    (["--uncertified"], "--uncertified = True"), (["--model-error", "0"], "--model-error = 0.0"),
    (["--set", "duration=9"], "--set = ['duration=9']")])
def test_a_replay_takes_nothing_that_the_campaign_decides(tmp_path, capsys, args, said):
    command = ["campaign", "girona500_contact", "--outside", "--replay", "2",
               "--output", str(tmp_path)]
    assert main([*command, *args]) == 2
    err = capsys.readouterr().err
    assert f"error: {said}" in err
    assert "must be left out with --replay: the campaign in the folder decides it" in err
    assert err.count("\n") == 1
    assert main([*command, "--runs", "100"]) == 2  # The default is as good as nothing.
    assert "left out" not in capsys.readouterr().err


def test_a_cluster_gives_the_same_bytes(reference, tmp_path):
    """A scheduler and two workers, each a process of its own."""
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True,
                                  dashboard_address=None) as cluster:
        assert main([*SHORT, "--runs", str(RUNS), "--scheduler", cluster.scheduler_address,
                     "--output", str(tmp_path)]) == 0
    assert result_bytes(tmp_path) == result_bytes(reference)


def test_a_killed_worker_of_a_cluster_is_replaced(reference, tmp_path):
    distributed = pytest.importorskip("distributed", reason="the extra 'cluster' is not installed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True,
                                  dashboard_address=None) as cluster:
        process = subprocess.Popen(
            [sys.executable, "-m", "uvms_drake", *SHORT, "--runs", str(RUNS), "--scheduler",
             cluster.scheduler_address, "--output", str(tmp_path)], stdout=subprocess.DEVNULL)
        wait_for(lambda: (tmp_path / RUNS_FILE).is_file())
        os.kill(next(iter(cluster.workers.values())).pid, signal.SIGKILL)
        assert process.wait(90) == 0
    assert result_bytes(tmp_path) == result_bytes(reference)
    assert sorted(indices_in(tmp_path)) == list(range(RUNS))


def test_without_a_cluster_it_is_one_line(capsys, tmp_path, monkeypatch):
    output = tmp_path / "result"
    if "distributed" in sys.modules:
        monkeypatch.setattr("uvms_drake.campaign.pool.CONNECT_SECONDS", 0.5)
    err = refusal(capsys, "--scheduler", "tcp://127.0.0.1:1", "--output", str(output))
    assert "--scheduler" in err
    assert not output.exists()


@pytest.fixture(scope="module")
def certified() -> Campaign:
    """Starts close to the wall, so that contact is made in 2 s."""
    scenario = load_scenario("girona500_contact", ["duration=2.0", CLOSE[1]])
    certificate = certified_once(scenario)
    assert certificate.certified
    return make_campaign(scenario, 0, certificate, model_error=0.2)


def test_surfaces_have_certificates_of_their_own(certified):
    """A stiffer one turns the same deviation into more force; a tilted one is pressed as hard."""
    declared = {(certified.walls[target.wall].stiffness, certified.walls[target.wall].tilt):
                certified.declared(target) for target in certified.targets}
    assert set(declared) == {(1.0, 0.0), *OTHER_WALLS}
    own = declared[1.0, 0.0]
    assert dump_scenario(own) == dump_scenario(certified.base)
    for (stiffness, tilt), scenario in declared.items():
        assert scenario.tube.e == pytest.approx(own.tube.e, rel=0.02)  # J_x over another set.
        assert scenario.surface.stiffness == pytest.approx(stiffness * own.surface.stiffness)
        normal, force = np.asarray(scenario.surface.normal), np.asarray(scenario.task.force)
        np.testing.assert_allclose(force[:3], -20.0 * normal, atol=1e-9)
        assert np.arccos(normal @ own.surface.normal) == pytest.approx(abs(tilt), abs=1e-7)
        assert certify(replace(scenario, tube=own.tube)).certified
    joints = [np.max(declared[stiffness, 0.0].tube.u[7:9]) for stiffness in (0.8, 1.0, 1.25)]
    assert joints == sorted(joints)
    assert len({target.factor for target in certified.targets}) == 4


def test_sixty_runs_stay_within_every_bound(certified):
    """The whole campaign has 20 s a run."""
    workers = min(2, multiprocessing.cpu_count())
    results = [run["result"] for _, run in run_all(certified, range(60), local_pool(workers))]
    summary = summarise_campaign(certified, results)
    assert len(results) == 60
    assert all_well(summary), summary["counts"]
    assert summary["counts"]["mpc_failures"] == 0
    assert summary["counts"]["not_covered"] <= 3
    assert len(summary["by_fault"]) == 4
    assert all(value > 0.0 for value in summary["largest_unknown"].values())
    worst = summary["distributions"]["ratio_trajectory"]
    assert 0.8 < worst["max"] < 1.0 + 2.0 * MONITOR_SLACK
    scenario = deepcopy(vary(certified, worst["worst"]).scenario)
    scenario.simulator.max_step_size = 0.005
    ratio = summarise(simulate(scenario))["tube"]["worst_ratio"]["trajectory"]
    assert 0.8 < ratio < 1.0005  # What was above one is the integrator's error.
