"""`control.feedback.tube_monitor` with kinematic motion: in closed loop, and on scripted states."""

from types import SimpleNamespace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import LogVectorOutput
from support.scripts import Script, report_of, use_fixed_steps

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.feedback.tube_monitor import FIELDS, NOT_STARTED, TUBE_REPORT, TubeMonitor
from uvms_drake.control.laws import Resolved
from uvms_drake.control.laws.law import pair_of
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.papers.nikou2018 import Transpose
from uvms_drake.papers.nikou2018.kinematics.disturbance import TaskAdversary
from uvms_drake.papers.nikou2018.kinematics.laws import velocity_law
from uvms_drake.papers.nikou2018.kinematics.plant import make_kinematic_plant
from uvms_drake.papers.nikou2018.kinematics.tube import kinematic_tubes
from uvms_drake.plant.disturbance import (
    ConstantDisturbance,
    RandomDisturbance,
    SinusoidalDisturbance,
)

pytestmark = pytest.mark.long

W_BOUND = 0.05
LAWS = {"resolved": Resolved(sigma=3.0), "transpose": Transpose(sigma=4.0)}
CONSTANT = ConstantDisturbance(W_BOUND, np.array([1.0, -2.0, 0.5, 0.3, -0.4, 1.0]))
ATTACKS = {"constant": CONSTANT, "sinusoid": SinusoidalDisturbance(W_BOUND, frequency=2.0),
           "random": RandomDisturbance(W_BOUND, 2.0), "adversary": None}
START = np.array([0.4, -1.2, 2.0, 0.1, -0.1, 0.7, 0.1, 0.9, 0.2, -0.4])
OFFSET = np.array([0.01, -0.02, 0.01, 0.02, -0.01, 0.03, 0.01, -0.02, 0.01, 0.02])


def nominal_velocity(time: float) -> np.ndarray:
    """ζ̄: forwards and sideways, turning, the arm in motion."""
    return np.array([0.3, 0.1 * np.sin(2.0 * time), -0.1, 0.1 * np.cos(time), 0.05, 0.2,
                     0.2 * np.cos(2.0 * time), 0.1, -0.2 * np.sin(time), 0.3])


def commanded(model, law, config, nominal_state) -> np.ndarray:
    """ζ of the laws, as their definitions have it."""
    nominal, nominal_zeta = np.split(nominal_state, 2)
    J, J_nominal = model.task_jacobian(config), model.task_jacobian(nominal)
    e_y = pose_difference(model.task_pose(config), model.task_pose(nominal))
    if isinstance(law, Resolved):
        return np.linalg.solve(J, J_nominal @ nominal_zeta - law.sigma * e_y)
    return nominal_zeta - law.sigma * J_nominal[:6].T @ e_y[:6]


def of_kinematics(law, w_bound: float = W_BOUND) -> dict:
    """Returns the options of a monitor of χ̇ = J(𝔮)ζ + w."""
    return {"weights": np.ones(6), "run_bound": velocity_law(law).run_bound(law, w_bound)}


class Nominal(LeafSystem):
    """𝔮̄̇ = Γ(𝔮̄) ζ̄(t)."""

    def __init__(self):
        super().__init__()
        self.DeclareContinuousState(BasicVector(START))
        self.DeclareVectorOutputPort(
            "nominal_state", 20, self._calc, {self.xc_ticket(), self.time_ticket()})

    def _calc(self, context, output):
        output.SetFromVector(np.concatenate([
            context.get_continuous_state_vector().CopyToVector(),
            nominal_velocity(context.get_time())]))

    def DoCalcTimeDerivatives(self, context, derivatives):
        derivatives.SetFromVector(configuration_rate(
            context.get_continuous_state_vector().CopyToVector(),
            nominal_velocity(context.get_time())))


class Law(LeafSystem):
    """Commands ζ by a law until it is switched off."""

    def __init__(self, model, law, until):
        super().__init__()
        config = self.DeclareVectorInputPort("configuration", 10)
        nominal = self.DeclareVectorInputPort("nominal_state", 20)

        def calc(context, output):
            nominal_state = nominal.Eval(context)
            output.SetFromVector(
                commanded(model, law, config.Eval(context), nominal_state)
                if context.get_time() < until else nominal_state[10:])

        self.DeclareVectorOutputPort("zeta", 10, calc)


def closed_loop(model, law, attack, *, start=START, until=np.inf, w_bound=W_BOUND, radii=None,
                duration=1.5, slack=1e-6, floor=1e-8, **options) -> SimpleNamespace:
    """Runs plant and law; `attack` None is a `TaskAdversary`."""
    builder = DiagramBuilder()
    plant = builder.AddSystem(make_kinematic_plant(
        "girona500_arm5e", disturbance=attack, seed=1))
    nominal = builder.AddSystem(Nominal())
    controller = builder.AddSystem(Law(model, law, until))
    builder.Connect(plant.GetOutputPort("configuration"), controller.GetInputPort("configuration"))
    builder.Connect(nominal.get_output_port(), controller.GetInputPort("nominal_state"))
    builder.Connect(controller.get_output_port(), plant.GetInputPort("zeta"))
    monitor = TubeMonitor.AddToBuilder(
        builder, model, law, w_bound, radii or {}, state=plant.GetOutputPort("state"),
        nominal_state=nominal.get_output_port(), disturbance=plant.GetOutputPort("disturbance"),
        **of_kinematics(law, w_bound), slack=slack, floor=floor, **options)
    if attack is None:
        adversary = TaskAdversary.AddToBuilder(
            builder, W_BOUND, np.eye(6)[1], e=monitor.GetOutputPort("e"))
        builder.Connect(adversary.get_output_port(), plant.GetInputPort("disturbance"))
    sinks = {name: LogVectorOutput(monitor.GetOutputPort(name), builder, 0.02)
             for name in ("deviation", "bound", "e", "e_y", "r")}
    simulator = Simulator(builder.Build())
    use_fixed_steps(simulator)
    simulator.get_mutable_integrator().set_maximum_step_size(0.01)
    root = simulator.get_mutable_context()
    plant.GetMyMutableContextFromRoot(root).SetContinuousState(start)
    simulator.AdvanceTo(duration)
    return SimpleNamespace(
        report=SimpleNamespace(**report_of(monitor, monitor.GetMyContextFromRoot(root))),
        **{name: sink.FindLog(root).data().T.copy() for name, sink in sinks.items()},
        simulator=simulator, monitor=monitor)


@pytest.mark.parametrize("name", LAWS)
def test_the_rates_bound_how_fast_the_error_grows(model, states, name):
    """𝔢̇ = J(𝔮)ζ − J(𝔮̄)ζ̄ + w with the law's ζ; for `resolved`, w along 𝔢 meets the bound."""
    law, rng = LAWS[name], np.random.default_rng(0)
    for nominal_state in np.vstack([states["free"], states["deep"]]):
        config = nominal_state[:10] + 0.02 * rng.normal(size=10)
        zeta = commanded(model, law, config, nominal_state)
        J, J_nominal = (model.task_jacobian(q)[:6] for q in (config, nominal_state[:10]))
        e = pose_difference(model.task_pose(config), model.task_pose(nominal_state[:10]))[:6]
        size = np.linalg.norm(e)
        decay, drive = rate_of(model, law, np.concatenate([config, zeta]), nominal_state)
        bound = -decay * size + drive
        for w in (e, *rng.normal(size=(20, 6))):
            e_dot = J @ zeta - J_nominal @ nominal_state[10:] + W_BOUND * w / np.linalg.norm(w)
            assert e @ e_dot / size <= bound + 1e-12
            if name == "resolved" and w is e:
                assert e @ e_dot / size == pytest.approx(bound)


def rate_of(model, law, state, nominal_state) -> tuple[float, float]:
    """Returns a and b of Ė = −aE + b, of the task."""
    now = pair_of(model, state, nominal_state)
    along = velocity_law(law).run_bound(law, W_BOUND)
    drive, moved = (along.rate(np.full(along.size, E), now)[0] for E in (0.0, 1.0))
    return drive - moved, drive


def self_moved(model) -> np.ndarray:
    """A 𝔮 with the end-effector of `START` and an arm in another posture."""
    return model.configuration(model.task_pose(START) + np.array([0.0] * 6 + [0.3, -0.4, 0.5, 0.2]))


def test_under_transpose_the_self_motion_of_the_arm_drives_the_error_too(model):
    """At 𝔢 = 0, ζ = ζ̄: a w along (J(𝔮) − J(𝔮̄))ζ meets the bound."""
    zeta, config = nominal_velocity(0.3), self_moved(model)
    J, J_nominal = (model.task_jacobian(q)[:6] for q in (config, START))
    np.testing.assert_allclose(model.task_pose(config)[:6], model.task_pose(START)[:6], atol=1e-12)
    arm = (J - J_nominal) @ zeta
    assert np.linalg.norm(arm) > W_BOUND
    w = W_BOUND * arm / np.linalg.norm(arm)
    _, drive = rate_of(model, LAWS["transpose"], np.concatenate([config, zeta]),
                       np.concatenate([START, zeta]))
    assert np.linalg.norm(J @ zeta - J_nominal @ zeta + w) == pytest.approx(drive)


def test_under_transpose_the_bound_holds_for_an_arm_in_another_posture(model):
    """The error exceeds by far what w alone could do at the least gain."""
    law = LAWS["transpose"]
    run = closed_loop(model, law, None, start=self_moved(model), duration=1.0)
    assert run.report.trajectory_exits == 0.0
    assert run.report.worst_trajectory_task > 0.8
    assert run.bound[0, 0] < 1e-12
    t = 0.02 * np.arange(len(run.deviation))
    assert np.any(run.deviation[:, 0] > 1.5 * W_BOUND * t)


@pytest.mark.parametrize("attack", ATTACKS)
def test_under_resolved_the_tube_is_never_left(model, attack):
    law = LAWS["resolved"]
    tube = kinematic_tubes(0.4, 0.0, law.sigma, W_BOUND).resolved
    run = closed_loop(model, law, ATTACKS[attack], radii={"task": tube, "r": 0.0})
    assert run.report.trajectory_exits == run.report.set_exits == 0.0
    assert run.report.disturbance_exits == 0.0
    assert run.report.worst_trajectory_task < 1.0 + 1e-5
    assert np.max(run.deviation[:, 0]) > 0.2 * tube
    assert np.all(run.deviation <= run.bound * (1.0 + 1e-6) + 1e-8)
    assert run.report.worst_disturbance == pytest.approx(1.0, rel=0.3)
    if attack in ("constant", "adversary"):  # 𝔢 keeps its direction: the bound is attained
        assert run.report.worst_trajectory_task > 0.999
        assert run.report.worst_set_task == pytest.approx(1.0 - np.exp(-1.5 * law.sigma), abs=1e-3)
        t = 0.02 * np.arange(len(run.bound))
        np.testing.assert_allclose(
            run.bound[:, 0], tube * (1.0 - np.exp(-law.sigma * t)), atol=1e-7)


@pytest.mark.parametrize("attack", ATTACKS)
def test_under_transpose_the_bound_along_the_run_is_never_exceeded(model, attack):
    run = closed_loop(model, LAWS["transpose"], ATTACKS[attack])
    assert run.report.trajectory_exits == run.report.disturbance_exits == 0.0
    assert run.report.worst_trajectory_task <= 1.0
    assert np.all(run.deviation <= run.bound * (1.0 + 1e-6) + 1e-8)
    assert np.all(np.isinf(run.bound[:, FIELDS.index("joints")]))
    assert np.max(run.deviation[:, 0]) > 1e-3
    if attack != "random":
        assert run.report.worst_trajectory_task > 0.3  # a bound, and one that says something
    np.testing.assert_allclose(run.r, 0.0, atol=1e-12)


@pytest.mark.parametrize("name", LAWS)
def test_the_bound_starts_at_a_start_off_the_nominal_one(model, name):
    """Without w, every 𝔢_b of `resolved` shrinks exactly as its bound."""
    run = closed_loop(
        model, LAWS[name], ConstantDisturbance(0.0), start=START + OFFSET, w_bound=0.0)
    assert run.report.trajectory_exits == 0.0
    if name == "resolved":
        np.testing.assert_allclose(run.bound[0, :4], run.deviation[0, :4], rtol=1e-12)
        np.testing.assert_allclose(run.deviation[:, :4], run.bound[:, :4], rtol=1e-4)
        assert run.deviation[-1, 3] < 0.02 * run.deviation[0, 3]
    else:
        assert run.bound[0, 0] == run.deviation[0, 0] > 0.02
        assert run.bound[-1, 0] < 0.5 * run.bound[0, 0]
        assert run.deviation[-1, 3] > 0.5 * run.deviation[0, 3]  # nothing brings the joints back


@pytest.mark.parametrize("name", LAWS)
def test_it_is_reported_where_the_law_is_switched_off(model, name):
    run = closed_loop(model, LAWS[name], CONSTANT, until=0.3,
                      radii={"task": W_BOUND / LAWS["resolved"].sigma})
    assert run.report.trajectory_exits == 1.0
    assert run.report.trajectory_first_exit == pytest.approx(0.3, abs=0.021)
    assert run.report.worst_trajectory_r > 1.0
    assert run.report.worst_trajectory_task > 1.2  # also beyond what a law would have allowed
    assert run.report.set_exits == 1.0
    assert run.report.set_first_exit > 0.3
    assert run.report.disturbance_exits == 0.0


def test_a_disturbance_above_its_bound_is_reported(model):
    run = closed_loop(model, LAWS["resolved"], CONSTANT, w_bound=0.5 * W_BOUND, duration=0.3)
    assert run.report.disturbance_exits == run.report.trajectory_exits == 1.0
    assert run.report.disturbance_first_exit == 0.0
    assert run.report.worst_disturbance == pytest.approx(2.0)
    assert run.report.worst_trajectory_task == pytest.approx(2.0)


def test_samples_at_the_steps_see_the_same_as_periodic_ones(model):
    reports = [closed_loop(model, LAWS["resolved"], CONSTANT, start=START + OFFSET, duration=0.2,
                           period=period).report for period in (0.01, 0.0)]
    for field in TUBE_REPORT:
        assert getattr(reports[0], field) == pytest.approx(
            getattr(reports[1], field), rel=1e-4, abs=1e-6)


def test_a_cloned_context_goes_on_identically(model):
    run = closed_loop(model, LAWS["resolved"], CONSTANT, start=START + OFFSET, duration=0.1)
    twin = Simulator(run.simulator.get_system(), run.simulator.get_context().Clone())
    use_fixed_steps(twin)
    twin.get_mutable_integrator().set_maximum_step_size(0.01)
    values = []
    for each in (run.simulator, twin):
        each.AdvanceTo(0.2)
        context = run.monitor.GetMyContextFromRoot(each.get_context())
        values.append([*report_of(run.monitor, context).values(),
                       *run.monitor.GetOutputPort("bound").Eval(context)])
    np.testing.assert_allclose(*values, rtol=1e-11)


def scripted(model, law, state, nominal, **options):
    """Returns a Simulator of a monitor that is shown constant states, and the monitor's Context."""
    builder = DiagramBuilder()
    script = builder.AddSystem(Script(state=lambda t: state, nominal=lambda t: nominal))
    monitor = TubeMonitor.AddToBuilder(
        builder, model, law, W_BOUND, {}, state=script.GetOutputPort("state"),
        nominal_state=script.GetOutputPort("nominal"), **of_kinematics(law), **options)
    simulator = Simulator(builder.Build())
    use_fixed_steps(simulator)
    return simulator, monitor, monitor.GetMyContextFromRoot(simulator.get_context())


@pytest.mark.parametrize("name", LAWS)
def test_where_nothing_moves_the_bounds_are_closed_forms(model, name):
    law, nominal = LAWS[name], np.concatenate([START, nominal_velocity(0.3)])
    state = np.concatenate([START + OFFSET, nominal_velocity(0.3)])
    simulator, monitor, context = scripted(model, law, state, nominal)
    J_x, J_x_nominal = (model.task_jacobian(x[:10]) for x in (state, nominal))
    e_y = model.task_pose(state[:10]) - model.task_pose(nominal[:10])
    np.testing.assert_allclose(monitor.GetOutputPort("e_y").Eval(context), e_y, atol=1e-12)
    np.testing.assert_allclose(monitor.GetOutputPort("e").Eval(context), e_y[:6], atol=1e-12)
    a, b = rate_of(model, law, state, nominal)

    def solution(first, drive, time):
        return drive / a + (first - drive / a) * np.exp(-a * time)

    for time in (0.0, 0.2, 0.7):
        simulator.AdvanceTo(time)
        bound = dict(zip(FIELDS, monitor.GetOutputPort("bound").Eval(context), strict=True))
        assert bound["r"] == 0.0
        if name == "resolved":
            for field, rows, drive in (
                    ("task", e_y, b), ("position", e_y[:3], b), ("orientation", e_y[3:6], b),
                    ("joints", e_y[6:], 0.0)):
                first = np.linalg.norm(rows)
                assert bound[field] == pytest.approx(solution(first, drive, time), rel=1e-7)
            offset = np.linalg.solve(J_x, (J_x_nominal - J_x) @ nominal[10:])
            assert bound["z"] == pytest.approx(
                law.sigma * np.linalg.norm(np.linalg.inv(J_x), 2) * bound["task"]
                + np.linalg.norm(offset))
        else:
            first = np.linalg.norm(e_y[:6])
            for field in ("task", "position", "orientation"):
                assert bound[field] == pytest.approx(solution(first, b, time), rel=1e-7)
            assert bound["joints"] == np.inf
            assert bound["z"] == pytest.approx(
                law.sigma * np.linalg.norm(J_x_nominal[:6], 2) * bound["task"])


@pytest.mark.parametrize("begin", [0.0, 0.33])
def test_it_may_start_at_any_time_and_starts_at_its_first_sample_that_counts(model, begin):
    nominal = np.concatenate([START, np.zeros(10)])
    state = np.concatenate([START + OFFSET, np.zeros(10)])
    simulator, monitor, context = scripted(model, LAWS["resolved"], state, nominal, period=0.01,
                                           begin=begin)
    simulator.get_mutable_context().SetTime(0.123)
    deviation, bound = (monitor.GetOutputPort(name) for name in ("deviation", "bound"))
    for time in (0.123, 0.128, begin - 0.002):
        simulator.AdvanceTo(max(time, simulator.get_context().get_time()))
        assert context.get_continuous_state_vector()[0] == NOT_STARTED
        np.testing.assert_array_equal(bound.Eval(context)[:4], deviation.Eval(context)[:4])
    simulator.AdvanceTo(max(0.13, begin) + 0.1)
    task = deviation.Eval(context)[0]
    radius, sigma = W_BOUND / 3.0, 3.0
    assert bound.Eval(context)[0] == pytest.approx(
        radius + (task - radius) * np.exp(-0.1 * sigma), rel=1e-6)


def test_its_ports_are_those_of_the_dynamic_one_but_for_the_disturbance(model):
    law = LAWS["resolved"]
    monitors = [TubeMonitor(model, law, W_BOUND, {}, **options)
                for options in (of_kinematics(law), {})]
    outputs, expected = ({
        monitor.get_output_port(i).get_name(): monitor.get_output_port(i).size()
        for i in range(monitor.num_output_ports())} for monitor in monitors)
    assert outputs == expected
    inputs = {monitors[0].get_input_port(i).get_name(): monitors[0].get_input_port(i).size()
              for i in range(3)}
    assert inputs == {"state": 20, "nominal_state": 20, "disturbance": 6}
    disturbance = monitors[0].GetInputPort("disturbance").get_index()
    for index in range(monitors[0].num_output_ports()):
        assert not monitors[0].HasDirectFeedthrough(disturbance, index)


@pytest.mark.parametrize(("arguments", "options", "message"), [
    ((LAWS["resolved"], -0.1, {}), {}, r"^d_bound = -0\.1: must be zero or positive$"),
    ((Transpose(sigma=0.0), 0.1, {}), {}, r"^sigma = 0\.0: must be positive$"),
    ((LAWS["resolved"], 0.1, {"tip": 1.0}), {}, r"^radii = \['tip'\]: .*task"),
    ((LAWS["resolved"], 0.1, {}), {"period": -1.0}, "^period = -1")])
def test_bad_parameters_are_named(model, arguments, options, message):
    with pytest.raises(InvalidParameter, match=message):
        TubeMonitor(model, *arguments, **of_kinematics(arguments[0]), **options)
