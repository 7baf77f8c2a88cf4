"""What `studies.bench.bench` counts, and that parts add up; never how long it takes."""

import inspect
import json
import re
from dataclasses import asdict, fields, replace
from functools import partial

import numpy as np
import pytest
from pydrake.systems.framework import LeafSystem
from support.laws import PAPER

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.common.jsonable import jsonable
from uvms_drake.control.feedback.ancillary import AncillaryFeedback
from uvms_drake.control.mpc.planner import FIRST_SOLVE_ITERATIONS
from uvms_drake.control.ocp import scp
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.station.diagram import make_station
from uvms_drake.station.problem import load_model, make_ocp, start_state
from uvms_drake.station.scenario.scenario import Scenario, load_scenario
from uvms_drake.station.step_size import with_step
from uvms_drake.studies.bench import bench
from uvms_drake.studies.bench.bench import Bench, SimulationTime, measure, write_bench
from uvms_drake.studies.bench.bench_controller import (
    STEP_PARTS,
    ControllerTimes,
    HorizonTimes,
    NominalLoop,
    conic_programs,
    measure_controller,
    measure_growth,
)
from uvms_drake.studies.bench.bench_feedback import _fixed
from uvms_drake.studies.bench.bench_plant import (
    DerivativeTimes,
    leaf_systems,
    penetrations,
    run_instants,
    watched_station,
)
from uvms_drake.studies.bench.bench_table import format_bench
from uvms_drake.studies.bench.stopwatch import Effort, Stopwatch, Timing, stopwatch

LITTLE = Effort(warm_up=1, steps=4, first_plans=2, instants=3, rounds=2, simulated=3.0,
                horizons=(3, 6), horizon_steps=2, solvers=("structured", "clarabel", "snopt"),
                solver_horizon=3, solver_steps=2)
SHORT = ["mpc.horizon=6"]


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return with_step(load_scenario("girona500_ideal", SHORT))


@pytest.fixture(scope="module")
def model(scenario) -> ContactModel:
    return load_model(scenario)


@pytest.fixture(scope="module")
def measured(scenario) -> tuple[Bench, list[str]]:
    """Measurements of the ideal scenario, and what was said meanwhile."""
    said: list[str] = []
    return measure(scenario, LITTLE, lambda what, _: said.append(what)), said


def loop_of(scenario: Scenario, model: ContactModel) -> NominalLoop:
    ocp = make_ocp(scenario, model)
    return NominalLoop(ocp, start_state(scenario, ocp))


def assert_ordered(timing: Timing) -> None:
    assert 0.0 <= timing.min <= timing.p50 <= timing.p95 <= timing.p99 <= timing.max
    assert timing.min <= timing.mean <= timing.max


# Timers ------------------------------------------------------------------------------------------


def test_the_product_is_left_as_it_was(measured, ocp):
    for function in (scp.solve_staged, type(ocp).linearise, type(ocp).staged_program):
        assert function.__module__ not in (bench.__name__, stopwatch.__module__)
    for name in ("DeclareVectorOutputPort", "DeclareAbstractOutputPort"):
        assert getattr(LeafSystem, name).__name__ == name


# Measurements ------------------------------------------------------------------------------------


def test_the_parts_add_up_to_the_total(measured):
    result = measured[0]
    for times in (result.controller, result.derivative):
        mean = sum(part.mean for part in times.parts.values())
        assert mean == pytest.approx(times.total.mean, rel=1e-9)
        for timing in (times.total, *times.parts.values()):
            assert_ordered(timing)


def test_the_controller_is_measured_as_often_as_asked(measured):
    times = measured[0].controller
    assert (times.horizon, times.steps, times.failures) == (6, 4, 0)
    assert tuple(times.parts) == STEP_PARTS
    assert all(part.min > 0.0 for part in times.parts.values())
    assert sum(times.conic_programs.values()) == 4
    assert 1 <= times.first_iterations < FIRST_SOLVE_ITERATIONS
    assert_ordered(times.first_plan)


def test_the_loop_makes_the_plans_of_the_controller(scenario, model):
    loop = loop_of(scenario, model)
    solver = SequentialConvexSolver(loop.ocp)
    plan = solver.solve(loop.ocp.resting_plan(0.0, start_state(scenario, loop.ocp)),
                        FIRST_SOLVE_ITERATIONS).plan
    loop.first()
    np.testing.assert_array_equal(loop.plan.decision, plan.decision)
    for _ in range(2):
        plan = solver.solve(loop.ocp.continued(plan), loop.ocp.iterations).plan
        loop.step()
        np.testing.assert_array_equal(loop.plan.decision, plan.decision)
    assert loop.plan.start_time == pytest.approx(2 * loop.ocp.time_step)
    assert not loop.failed()


def test_conic_programs_are_counted(scenario, model, monkeypatch):
    solve, counts = scp.solve_staged, iter([3, None, 0, 2, 5])

    def solve_staged(program):
        count = next(counts)
        return None if count is None else solve(program)._replace(cone_programs=count)

    monkeypatch.setattr(scp, "solve_staged", solve_staged)
    loop = loop_of(replace(scenario, mpc=replace(scenario.mpc, iterations=1)), model)
    taken = []
    with conic_programs() as take:
        for _ in range(5):
            loop.step()
            taken.append((take(), loop.failed()))
    assert taken == [(3, False), (0, True), (0, False), (2, False), (5, False)]
    assert scp.solve_staged is solve_staged


def test_failed_steps_are_counted_and_go_on_with_the_old_plan(scenario, model, monkeypatch):
    monkeypatch.setattr(scp, "solve_staged", lambda program: None)
    times = measure_controller(loop_of(scenario, model), LITTLE)
    assert (times.steps, times.failures, times.conic_programs) == (4, 4, {0: 4})


def test_the_derivative_is_measured_off_and_on_the_surface(measured):
    times = measured[0].derivative
    assert times.evaluations == 6
    assert times.on_surface + times.off_surface == 3
    assert min(times.on_surface, times.off_surface) > 0


def test_the_systems_in_python_that_the_derivative_needs_are_its_parts(measured, scenario):
    *parts, last = measured[0].derivative.parts
    assert last == "rest"
    assert set(parts) <= set(leaf_systems(make_station(scenario)))
    assert not [path for path in parts if path.startswith("log.") or path == "uvms/plant"]
    assert set(parts) >= {"uvms/surface", "uvms/hydrodynamics", "disturbance",
                          "uvms/to_paper_order", "tube_mpc/nominal_mpc", "tube_mpc/ancillary",
                          "tube_monitor"}
    assert all(part.min > 0.0 for part in measured[0].derivative.parts.values())


def test_a_command_of_the_feedback_is_timed_beside_one_of_resolved(measured):
    times = measured[0].feedback
    assert times.law == "resolved"
    assert 0.0 < times.command.min <= times.command.p50
    assert times.ratio == times.command.p50 / times.resolved.p50
    assert f"{times.ratio:.2f} times as long" in format_bench(measured[0])


def test_what_is_timed_is_the_command_of_the_loop(scenario):
    station = make_station(scenario)
    (feedback,) = (leaf for leaf in leaf_systems(station).values()
                   if isinstance(leaf, AncillaryFeedback))
    for context in run_instants(station, scenario.simulator, scenario.duration, LITTLE):
        inner = feedback.GetMyContextFromRoot(context)
        tau = feedback.GetOutputPort("tau").Eval(_fixed(feedback, feedback, inner))
        np.testing.assert_array_equal(tau, feedback.GetOutputPort("tau").Eval(inner))


def test_a_watched_station_has_the_same_derivative_and_nothing_is_left_in_caches(scenario):
    watch = Stopwatch()
    stations = [make_station(scenario), watched_station(partial(make_station, scenario), watch)]
    assert set(leaf_systems(stations[0])) == set(leaf_systems(stations[1]))
    contexts = [run_instants(station, scenario.simulator, 0.1, replace(LITTLE, instants=1))[0]
                for station in stations]
    values = [station.EvalTimeDerivatives(context).CopyToVector()
              for station, context in zip(stations, contexts, strict=True)]
    np.testing.assert_array_equal(*values)
    context, station = contexts[1], stations[1]
    parts = []
    for _ in range(2):
        context.SetTimeAndContinuousState(
            context.get_time(), context.get_continuous_state_vector().CopyToVector())
        parts.append(set(watch.measure(lambda: station.EvalTimeDerivatives(context))))
    assert parts[0] == parts[1]
    assert set(leaf_systems(station).values()) > parts[0] - {"rest"} != set()
    assert set(watch.measure(lambda: station.EvalTimeDerivatives(context))) == {"rest"}


def test_what_is_on_the_surface_is_what_the_plant_says(scenario, model):
    station = make_station(scenario)
    contexts = run_instants(station, scenario.simulator, scenario.duration, LITTLE)
    depth = station.GetOutputPort("penetration")
    states = np.stack([station.GetOutputPort("state").Eval(context) for context in contexts])
    np.testing.assert_allclose(
        penetrations(model, states), [depth.Eval(context)[0] for context in contexts],
        atol=1e-12)


def test_the_simulation_is_as_long_as_asked(measured):
    times = measured[0].simulation
    assert times.simulated_s == LITTLE.simulated
    assert times.real_time_factor == pytest.approx(times.simulated_s / times.wall_s)


def test_the_growth_is_relative_to_the_first_horizon(measured):
    first, second = measured[0].growth
    assert (first.horizon, second.horizon, first.ratio) == (3, 6, 1.0)
    assert second.per_interval == pytest.approx(second.step.p50 / 6)
    assert second.ratio == pytest.approx(second.per_interval / first.per_interval)
    for row in (first, second):
        assert row.conic_programs >= 0.0
        assert (row.steps, row.failures) == (LITTLE.horizon_steps, 0)
        assert_ordered(row.step)


def test_the_growth_takes_one_step_at_least(scenario, model):
    rows = measure_growth([loop_of(scenario, model)] * 2, replace(LITTLE, horizon_seconds=0.0))
    assert [row.steps for row in rows] == [1, 1]


def test_each_solver_is_measured_from_the_same_plans(measured):
    first, *others = measured[0].solvers
    assert (first.solver, first.ratio) == ("structured", 1.0)
    assert [row.solver for row in others] == ["clarabel", "snopt"]
    for row in measured[0].solvers:
        assert (row.horizon, row.steps, row.failures) == (3, 2, 0)
        assert row.ratio == row.step.p50 / first.step.p50
        assert_ordered(row.step)
    table = format_bench(measured[0])
    assert re.search(r"step by solver, N = 3 .*ratio", table)
    assert re.search(r"\n  snopt +[\d.]+ ", table)


def test_what_is_measured_next_is_said(measured):
    assert len(measured[1]) == len(set(measured[1])) == 6


@pytest.mark.parametrize(("name", "overrides"), [
    ("girona500_ideal", ["mpc.iterations=2", f"limits.tau={[500] * 10}", f"tube.tau={[10] * 10}",
                           "simulator.target_realtime_rate=0.5"]),
    ("girona500_bilateral", [PAPER, "ancillary=!Transpose {k: 20, sigma: 1}", "duration=0.1",
                             "simulator.integration_scheme=runge_kutta2"])])
def test_other_scenarios_can_be_measured_too(name, overrides):
    scenario = load_scenario(name, ["mpc.horizon=4", *overrides])
    result = measure(scenario, replace(LITTLE, first_plans=1, simulated=0.2, horizons=(2,)))
    assert result.simulation.simulated_s == min(0.2, scenario.duration)
    assert format_bench(result).startswith(f"{name}: ")


def test_a_value_that_cannot_be_used_is_refused_before_anything_is_measured(scenario):
    said: list[str] = []
    with pytest.raises(InvalidParameter, match=r"ancillary\.k"):
        measure(replace(scenario, ancillary=replace(scenario.ancillary, k=-1.0)), LITTLE,
                lambda what, _: said.append(what))
    assert said == []


# Output ------------------------------------------------------------------------------------------


def test_the_file_holds_what_was_measured(measured, tmp_path):
    write_bench(measured[0], tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["bench.json"]
    stored = json.loads((tmp_path / "bench.json").read_text(encoding="utf-8"))
    assert set(stored) == {field.name for field in fields(Bench)}
    assert stored == json.loads(json.dumps(jsonable(asdict(measured[0]))))
    assert set(stored["machine"]) == {"cpus", "load_average", "cpu_share"}
    assert set(stored["versions"]) == {"uvms_drake", "drake", "numpy", "python"}


@pytest.mark.parametrize("owner", [
    Bench, ControllerTimes, DerivativeTimes, HorizonTimes, SimulationTime, Timing])
def test_every_key_of_the_file_is_explained(owner):
    text = inspect.getsource(owner)
    for field in fields(owner):
        assert re.search(rf'^    {field.name}: .*\n    """', text, re.MULTILINE), field.name


def test_the_table_shows_every_part(measured):
    result = measured[0]
    text = format_bench(result)
    lines = text.splitlines()
    assert max(map(len, lines)) <= 120
    for name in (*result.controller.parts, *result.derivative.parts, "first plan", "N = 3"):
        assert any(line.strip().startswith(name) for line in lines), name
    assert text.count("100.0%") == 2
    assert "4 steps, 0 failures" in text
    assert f"Drake {result.versions['drake']}" in text


def test_the_load_average_may_be_unknown(measured, monkeypatch):
    def unknown():
        raise OSError

    monkeypatch.setattr(bench.os, "getloadavg", unknown)
    assert bench.load_average() is None
    machine = {**measured[0].machine, "load_average": None}
    assert "load average unknown" in format_bench(replace(measured[0], machine=machine))
