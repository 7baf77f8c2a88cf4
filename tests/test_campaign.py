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
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from uvms_drake.campaign.command import CampaignProgress, replayed
from uvms_drake.campaign.pool import ONE_THREAD, local_pool, run_all
from uvms_drake.campaign.report import (
    all_well,
    distribution,
    format_campaign,
    summarise_campaign,
    summarise_wall,
)
from uvms_drake.campaign.run import run_one
from uvms_drake.campaign.setup import Campaign, Target, make_campaign
from uvms_drake.campaign.store import RUNS_FILE, SETUP_FILE, read_setup, run_log
from uvms_drake.campaign.vary import POSE_REACH, vary
from uvms_drake.certificate.certify import certified_once
from uvms_drake.cli import main
from uvms_drake.errors import InvalidParameter, RunFailed
from uvms_drake.model.contact import make_surface_law
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.adversary import AdversarialDisturbance
from uvms_drake.scenario import dump_scenario, load_scenario
from uvms_drake.simulation import simulate
from uvms_drake.station import MONITOR_SLACK, make_ocp, start_state
from uvms_drake.summary import summarise

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
    assert dump_scenario(vary(campaign, 4)) == dump_scenario(vary(campaign, 4))
    assert dump_scenario(vary(campaign, 4)) != dump_scenario(vary(campaign, 5))
    assert dump_scenario(vary(campaign, 4)) != dump_scenario(vary(replace(campaign, seed=4), 4))


def test_what_is_drawn_is_inside_the_bounds_and_comes_in_all_kinds(campaign):
    base = campaign.base
    kinds = set()
    for index in range(25):
        scenario = vary(campaign, index)
        start_state(scenario, make_ocp(scenario))  # raises outside of the nominal limits
        moved = np.abs(scenario.start.eta - base.start.eta)
        assert np.all(moved <= POSE_REACH)
        assert scenario.disturbance.bound == base.disturbance.bound
        kinds.add(getattr(scenario.disturbance, "kind", type(scenario.disturbance).__name__))
    assert len(kinds) > 6


def test_a_scenario_with_an_adversary_goes_through_a_file(campaign, tmp_path):
    aimed = next(scenario for scenario in (vary(campaign, index) for index in range(20))
                 if isinstance(scenario.disturbance, AdversarialDisturbance))
    file = tmp_path / "aimed.yaml"
    file.write_text(dump_scenario(aimed), encoding="utf-8")
    assert dump_scenario(load_scenario(str(file))) == dump_scenario(aimed)


def test_another_desired_force_has_the_terminal_set_of_its_own(campaign):
    other = replace(campaign, targets=(Target(0.8, 0.3),))
    scenario = vary(other, 0)
    np.testing.assert_allclose(scenario.task.force, 0.8 * np.asarray(campaign.base.task.force))
    assert scenario.mpc.terminal_radius == 0.3


def test_a_base_that_cannot_be_used_says_so(campaign):
    text = campaign.scenario.replace("force: [20.0", "force: [900.0")
    with pytest.raises(InvalidParameter, match=r"limits\.u"):
        vary(replace(campaign, scenario=text), 0)


def test_a_run_that_raises_is_a_result(campaign, monkeypatch):
    def breaks(scenario, certified):
        raise ZeroDivisionError("of\nno use")

    monkeypatch.setattr("uvms_drake.campaign.run.simulate", breaks)
    run = run_one(campaign, 2)
    assert run["result"]["error"] == "ZeroDivisionError: of no use"
    assert run["result"]["index"] == 2
    summary = summarise_campaign(campaign, [run["result"]])
    assert summary["counts"]["exceptions"] == 1
    assert not all_well(summary)
    assert "exceptions: 1" in format_campaign(summary, summarise_wall([run["wall"]]), "DIR")


def test_the_workers_take_one_core_each_and_the_parent_is_left_as_it_was(monkeypatch):
    monkeypatch.setenv(ONE_THREAD[0], "7")
    with local_pool(1)() as executor:
        assert executor.submit(os.getenv, ONE_THREAD[0]).result() == "1"
    assert os.environ[ONE_THREAD[0]] == "7"


def test_the_distribution_tells_whose_the_worst_is():
    results = [{"index": i, "margin": value, "force_error": value}
               for i, value in ((4, 0.3), (7, 0.1), (9, None), (2, 0.2))]
    assert distribution(results, "margin")["worst"] == 7
    assert distribution(results, "force_error") == {
        "count": 3, "min": 0.1, "median": 0.2, "p95": pytest.approx(0.29), "max": 0.3, "worst": 4}
    assert distribution([], "margin")["worst"] is None


def test_all_files_are_there(reference):
    assert {path.name for path in reference.iterdir()} == {
        SETUP_FILE, RUNS_FILE, "campaign.json", "timing.json", "campaign_ratios.png",
        "campaign_outcomes.png"}
    data = json.loads(result_bytes(reference))
    assert [result["index"] for result in data["results"]] == list(range(RUNS))
    assert data["counts"]["exceptions"] == data["counts"]["exits_trajectory"] == 0
    assert "seconds" not in result_bytes(reference).decode()
    assert json.loads((reference / "timing.json").read_text())["seconds"]["median"] > 0.0


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
    assert f"2 of {RUNS} runs are there already" in capsys.readouterr().err
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

    with pytest.raises(RunFailed, match="die before any run comes back: gone"):
        list(run_all(campaign, [0, 1], pool))


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


def test_a_folder_in_use_is_refused(campaign, tmp_path, capsys):
    with run_log(tmp_path, campaign):
        assert "no other process" in refusal(capsys, "--output", str(tmp_path))


def test_what_an_error_of_the_model_induces_is_what_the_plant_does():
    """Held against differences of its velocity, and M⁻¹(τ − n) − M̂⁻¹(τ − n̂) by both models."""
    scenario = load_scenario("girona500_contact", [
        "duration=1.0", CLOSE[1], "model_error.added_mass=1.2", "model_error.drag=0.8",
        "model_error.buoyancy_lever=1.1", "model_error.mass=1.02", "simulator.max_step_size=0.002",
        "log_period=0.002"])
    record = simulate(scenario)

    def acceleration(error):
        model = UvmsModel.load(scenario.model, make_surface_law(scenario.surface), error)
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


def test_runs_with_errors_of_the_model_keep_the_tube_where_d_covers_them(campaign):
    off = replace(campaign, model_error=0.1)
    results = [run_one(off, index)["result"] for index in range(6)]
    summary = summarise_campaign(off, results)
    assert all_well(summary), summary["counts"]
    assert summary["counts"]["outside"] < 4
    assert 0.002 < summary["distributions"]["induced"]["max"] < 0.1
    assert "errors of the model of up to 10 %" in format_campaign(summary, {"seconds": None}, "DIR")


@pytest.mark.parametrize(("args", "words"), [
    (["--runs", "0"], "--runs = 0: must be at least 1"),
    (["--runs", "many"], "invalid int value"),
    (["--seed", "-1"], "--seed = -1"),
    (["--workers", "0"], "--workers = 0"),
    (["--model-error", "2"], "--model-error = 2.0"),
    (["--set", "model_error.drag=-1"], "model_error.drag"),
    (["--workers", "1", "--scheduler", "tcp://127.0.0.1:1"], "not allowed with"),
    (["--set", "disturbance.bound=-1"], "disturbance.bound"),
    (["--set", "task.force=[900, 0, 0, 0, 0, 0]"], "limits.u"),
])
def test_bad_input_is_one_line_and_nothing_is_written(capsys, tmp_path, args, words):
    output = tmp_path / "result"
    assert words in refusal(capsys, "--output", str(output), *args)
    assert not output.exists()


def test_a_run_can_be_replayed_alone(reference, capsys):
    result = json.loads(result_bytes(reference))["results"][2]
    record = replayed(reference, 2)
    assert np.linalg.norm(record.force[-1] - record.scenario.task.force) == pytest.approx(
        result["force_error"], rel=1e-12)
    assert read_setup(reference).seed == 3
    assert main(["campaign", "--output", str(reference), "--replay", "2"]) == 0
    assert (reference / "run-2" / "scenario.yaml").is_file()
    assert (reference / "run-2" / "force.png").is_file()
    capsys.readouterr()
    assert main(["campaign", "--replay", "2"]) == 2
    assert main(["campaign", "--replay", "2", "--output", str(reference / "run-2")]) == 2
    assert capsys.readouterr().err.count("\n") == 2


def test_progress_in_a_log_file_is_a_few_lines(tmp_path):
    with (tmp_path / "log").open("w+", encoding="utf-8") as file:
        progress = CampaignProgress(200, file)
        for _ in range(200):
            progress.step()
        progress.close()
        file.seek(0)
        lines = file.read().splitlines()
    assert len(lines) == 10
    assert lines[-1].startswith("run 200 of 200")
    assert lines[-1].endswith("about 0 s left")


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


def test_sixty_runs_stay_within_every_bound():
    """Starts close to the wall, so that contact is made; the whole campaign has 20 s a run."""
    scenario = load_scenario("girona500_contact", ["duration=2.0", CLOSE[1]])
    certificate = certified_once(scenario)
    assert certificate.certified
    campaign = make_campaign(scenario, 0, certificate)
    assert len(campaign.targets) > 4
    workers = min(2, multiprocessing.cpu_count())
    results = [run["result"] for _, run in run_all(campaign, range(60), local_pool(workers))]
    summary = summarise_campaign(campaign, results)
    assert len(results) == 60
    assert all_well(summary), summary["counts"]
    assert summary["counts"]["disturbance_excesses"] == 0
    worst = summary["distributions"]["ratio_trajectory"]
    assert 0.8 < worst["max"] < 1.0 + 2.0 * MONITOR_SLACK
    scenario = vary(campaign, worst["worst"])
    scenario.simulator.max_step_size = 0.005
    ratio = summarise(simulate(scenario))["tube"]["worst_ratio"]["trajectory"]
    assert 0.8 < ratio < 1.0005  # What was above one is the integrator's error.
