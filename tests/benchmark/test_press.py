"""Figures of merit of made-up traces against sums by hand, events of a run, and the MPCs alone."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

import uvms_drake as uv
from uvms_drake.benchmark.cases import CASES, ROBOTS, Case, drawn_case
from uvms_drake.benchmark.controllers import CONTROLLERS
from uvms_drake.benchmark.press import AfterTouch, Course, Trace, measure, run_press, way_off
from uvms_drake.control.mpc.planner import MPC_REPORT
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.problem import true_surface
from uvms_drake.station.scenario.scenario import dump_scenario, load_scenario

GIRONA = "girona500_arm5e"


@pytest.fixture(scope="module")
def scenario():
    return drawn_case(GIRONA, CASES["thrusters"], 1, 0)[0]


@pytest.fixture(scope="module")
def model(scenario):
    return uv.load_model(scenario)


def traced(scenario, model, time, force, *, ended="", steps=(1.0,), surge=0.0, **signals):
    """A trace at the start with a force (T,) along x, and other signals."""
    rows = len(time)
    state = np.tile(np.concatenate([scenario.start.config, np.zeros(model.size)]), (rows, 1))
    state[:, model.size] = surge
    zero = np.zeros((rows, model.size))
    return Trace(time, {
        "state": state, "chi": zero[:, :6], "force": np.outer(force, np.eye(6)[0]),
        "penetration": (force > 0.0).astype(float)[:, None], "tau": zero, "place": zero[:, :3],
        **signals}, np.array(steps), ended)


def test_force_settling_loss_saturation_and_energy_are_those_of_the_trace(scenario, model):
    time = np.linspace(0.0, 10.0, 501)
    force = np.where(time < 2.0, 0.0, np.where(time < 4.0, 26.0, 21.0))
    force[(time > 2.5) & (time < 3.0)] = 0.0  # The contact is lost once.
    force[(time > 3.4) & (time < 3.5)] = 28.0  # Later than the impact.
    exerted = np.outer(np.full(501, -7.0), np.eye(model.size)[0])
    found = measure(scenario, model, traced(
        scenario, model, time, force, surge=0.3, steps=(0.001, 0.004, 0.002), exerted=exerted,
        chi=np.tile([0.1, 0.003, 0.004, 0.0, 0.0, 0.0], (501, 1)),
        input_limited=(time < 1.0).astype(float)[:, None]))
    assert found["force_rms"] == pytest.approx(1.0)
    assert (found["impact"], found["peak"]) == (26.0, 28.0)
    assert found["touch"] == found["settling"] == pytest.approx(2.0)
    assert found["lateral"] == pytest.approx(0.005)
    assert found["lost"] == 1
    assert found["limits"]["nu1"] == pytest.approx(0.05)  # 0.3 m/s of surge.
    assert not {"force", "qdot"} & set(found["limits"])
    assert found["saturated"] == pytest.approx(0.1, abs=0.002)
    assert found["energy"] == pytest.approx(7.0 * 0.3 * 10.0)
    assert (found["step_ms"], found["worst_step_ms"]) == pytest.approx((2.0, 4.0))
    assert found["chatter"] == 0.0


def test_a_run_without_touch_has_no_force_and_chatter_is_over_the_largest_command(scenario, model):
    tau = np.outer(np.arange(51) % 2, np.eye(model.size)[4])
    found = measure(scenario, model, traced(
        scenario, model, np.linspace(0.0, 1.0, 51), np.zeros(51), tau=tau))
    assert found["chatter"] == pytest.approx(50.0 / 90.0)  # 90 N m of pitch.
    assert found["peak"] == 0.0
    assert all(found[key] is None for key in (
        "impact", "lateral", "force_rms", "touch", "settling"))


def test_an_excess_of_the_declared_force_and_a_run_that_ends_early_are_told(scenario, model):
    force = np.repeat([0.0, scenario.contact.force + 3.0], [25, 26])
    found = measure(scenario, model, traced(
        scenario, model, np.linspace(0.0, 1.0, 51), force, ended="force beyond 500 N",
        wrench_shortfall=np.tile([0.0, 2.0, 0.0, 9.0, 0.0, 0.0], (51, 1))))
    assert found["limits"]["force"] == pytest.approx(3.0)
    assert found["ended"] == "force beyond 500 N"
    assert found["force_rms"] is found["settling"] is found["lateral"] is None
    assert found["touch"] == pytest.approx(0.5) and found["saturated"] == 1.0


def test_what_is_asked_outside_of_the_class_is_that_of_the_trace(scenario, model):
    time, n = np.linspace(0.0, 10.0, 501), sensed_contact(scenario).direction
    limit = scenario.contact.force
    trace = traced(scenario, model, time, np.where(np.abs(time - 5.0) < 1.0, limit + 1.0, 1.0))
    state = trace.signals["state"]
    state[:, :3] -= np.outer(np.clip(0.1 * (time - 4.0), 0.0, 0.5), n)  # 0.2 m beyond the way back.
    state[time < 3.0, 1] += 7.0  # Before the event.
    state[:, 6] = np.where(time > 9.0, model.q_upper[0] + 0.02, 0.0)
    trace.signals["force"][time < 3.0, :3] = 2.0 * limit * n  # Before the event, too.
    found = measure(scenario, model, trace, 3.5)
    assert found["peak"] == pytest.approx(limit + 1.0)
    assert found["above"] == pytest.approx(2.0, abs=0.05)
    assert found["off"] == pytest.approx(0.2)
    assert found["beyond"] == pytest.approx(0.02)
    assert measure(scenario, model, trace)["off"] > 6.9  # From the touch, at zero.
    assert measure(scenario, model, trace, 11.0)["off"] is None  # It ended before its event.
    across = np.linalg.norm(np.cross(n, [0.0, 0.3, 0.4]))
    assert way_off(np.outer([0.0, 1.0], np.array([0.0, 0.3, 0.4])), n) >= across - 1e-12


def test_the_course_of_an_event_ends_after_it_whenever_it_touches():
    course = Course(latest=16.0, after=8.0, event=15.0, lasting=6.0)
    assert course.end(np.inf) == course.end(3.0) == 21.0


def test_the_course_of_a_run_begins_at_its_touch():
    course = Course(latest=16.0, after=8.0, slide=np.array([0.0, 0.5, 0.0]))
    assert (course.end(np.inf), course.end(4.0)) == (16.0, 12.0)
    moved = [course.moved(since)[1] for since in (-np.inf, 2.0, 4.0, 50.0)]
    assert moved == pytest.approx([0.0, 0.0, 0.05, 0.5])
    builder = DiagramBuilder()
    touched = np.outer(np.eye(6)[0], [0.0, 0.0, 5.0, 0.0])
    force = builder.AddSystem(TrajectorySource(
        PiecewisePolynomial.ZeroOrderHold([0.0, 1.0, 2.0, 3.0], touched)))
    source = builder.AddSystem(AfterTouch(lambda since: np.array([since]), 1))
    builder.Connect(force.get_output_port(), source.get_input_port())
    simulator = Simulator(builder.Build())
    for now in np.arange(0.0, 4.05, 0.1):
        simulator.AdvanceTo(now)
    context = source.GetMyContextFromRoot(simulator.get_context())  # It does not begin again.
    assert source.get_output_port().Eval(context)[0] == pytest.approx(2.0, abs=0.11)


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_draw_is_a_function_of_seed_and_index_alone(robot):
    first, again, other = (dump_scenario(drawn_case(robot, CASES["thrusters"], seed, index)[0])
                           for seed, index in ((3, 1), (3, 1), (3, 2)))
    assert first == again != other


def test_cases_share_their_draw_and_differ_as_named(scenario):
    assert 0.05 <= scenario.actuation[1].lag <= 0.15
    stiffness = true_surface(scenario).law.stiffness
    for name, ratio in (("soft", 0.2), ("stiff", 5.0), ("very_stiff", 20.0)):
        other, _ = drawn_case(GIRONA, CASES[name], 1, 0)
        assert true_surface(other).law.stiffness == pytest.approx(ratio * stiffness)
        assert other.start.config == pytest.approx(scenario.start.config)
        assert other.actuation[1].lag == scenario.actuation[1].lag
    tilted, _ = drawn_case(GIRONA, CASES["tilt"], 1, 0)
    normal = np.asarray(true_surface(tilted).geometry.normal)
    assert np.degrees(np.arccos(-normal[0])) == pytest.approx(5.0, abs=0.01)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("case", CASES.values(), ids=lambda case: case.name)
def test_every_case_can_be_drawn(robot, case):
    scenario, course = drawn_case(robot, case, 1, 0)
    assert isinstance(scenario.contact, uv.SensedContact)
    assert scenario.duration == pytest.approx(
        course.latest + max(course.after, course.lasting))
    assert scenario.duration >= course.end(course.latest)
    starts = [fault.start for fault in scenario.faults if case.outside]
    assert starts == ([] if course.event is None else [course.event])
    assert case.outside or course.event is None
    if case.name == "hard":
        own = load_scenario(ROBOTS[robot].scenario).surface.law.stiffness
        assert scenario.surface.law.stiffness == pytest.approx(100.0 * own)
    assert (scenario.disturbance.label == "impulse") == (case.name == "impulse")


def test_the_nominal_mpc_sends_its_plan_from_the_measured_state(monkeypatch):
    """The command is ζ̄̇ − f, whatever the deviation; the plan is an optimum, which SNOPT keeps."""
    found = []
    solve = SequentialConvexSolver.solve

    def recording(self, guess, *args):
        found.append((self.ocp, solve(self, guess, *args)))
        return found[-1][1]

    monkeypatch.setattr(SequentialConvexSolver, "solve", recording)
    scenario, _ = drawn_case(GIRONA, CASES["ideal"], 1, 0)
    model = uv.load_model(scenario)
    controller = CONTROLLERS["nominal_mpc"](scenario, model)
    simulator = Simulator(controller)
    context = simulator.get_mutable_context()
    state = np.concatenate([scenario.start.config, np.zeros(model.size)])
    for name, value in (("state", state), ("force_measured", np.zeros(6)),
                        ("force_valid", np.zeros(6))):
        controller.GetInputPort(name).FixValue(context, value)
    simulator.Initialize()
    ((ocp, solution),) = found
    other = uv.make_solver(ocp, "snopt").solve(solution.plan)
    assert other.converged
    assert solution.evaluation.cost == pytest.approx(other.evaluation.cost, rel=1e-6)
    planned = controller.GetOutputPort("nominal_input").Eval(context)
    assert np.max(np.abs(planned)) > 0.01
    report = dict(zip(MPC_REPORT, controller.GetOutputPort("report").Eval(context), strict=True))
    assert report["status"] == 0.0 and report["violation"] < 1e-6
    moved = state + 0.003 * np.eye(2 * model.size)[1]
    for measured in (state, moved):
        controller.GetInputPort("state").FixValue(context, measured)
        u = controller.GetOutputPort("u").Eval(context)
        due = planned + model.drift(*np.split(controller.GetOutputPort(
            "nominal_state").Eval(context), 2)) - model.drift(*np.split(measured, 2))
        assert u == pytest.approx(due, abs=2e-3)


@pytest.mark.long
def test_the_observer_removes_the_steady_error_of_a_nominal_mpc():
    """On a wall of wrong stiffness, with wrong masses and a constant disturbance.

    Its plans begin at the measured state, and so follow the newest reading, not a mean of them.
    """
    wrong = Case("", "", (
        "surface_error.stiffness=0.5", "model_error.mass=1.1",
        "disturbance=!ConstantDisturbance {bound: 0.02}"), ideal=True)
    scenario, course = drawn_case(GIRONA, wrong, 977, 0)
    model, errors = uv.load_model(scenario), {}
    for name in ("nominal_mpc", "nominal_mpc_offset_free"):
        trace = run_press(scenario, model, CONTROLLERS[name](scenario, model), course)
        last = trace.time > trace.time[-1] - 1.0
        errors[name] = np.mean(trace.signals["force"][last, 0]) - scenario.task.force[0]
    assert abs(errors["nominal_mpc"]) > 1.0
    assert errors["nominal_mpc_offset_free"] == pytest.approx(0.0, abs=0.02)
