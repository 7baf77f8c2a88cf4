"""The plant whose input is the velocity: it moves as ẏ = J_x ζ + (w, 0), by independent means."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, MatrixGain
from support import dh

from uvms_drake.common.errors import InvalidParameter, RunFailed
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.euler import wrap_angle
from uvms_drake.model.robot import Robot
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.papers.nikou2018.kinematics.plant import (
    PITCH_MARGIN,
    carried_rate,
    make_kinematic_plant,
)
from uvms_drake.plant.disturbance import (
    ConstantDisturbance,
    RandomDisturbance,
    SinusoidalDisturbance,
)

MODEL = "girona500_arm5e"
START = np.array([0.4, -1.2, 2.0, 0.1, -0.2, 0.7, 0.2, 0.8, 0.1, -0.4])
ZETA = np.array([0.3, -0.2, 0.1, 0.2, -0.1, 0.3, 0.2, -0.1, 0.15, 0.3])
CALM = ConstantDisturbance(0.0)
KINDS = {"constant": ConstantDisturbance(0.2, np.array([1.0, -2.0, 0.5, 0.3, -0.4, 1.0])),
         "sinusoid": SinusoidalDisturbance(0.2 * np.sqrt(6.0)),  # the paper's
         "random": RandomDisturbance(0.4, 2.0)}
BARE = """
<sdf version="1.9"><model name="bare">
  <link name="vehicle"><inertial><mass>5.3</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz>
    </inertia></inertial></link>
  <frame name="tip" attached_to="vehicle"><pose>0.4 -0.05 0.1 0.3 0.5 -0.2</pose></frame>
</model></sdf>"""


def make(disturbance=CALM, robot=MODEL, **kwargs):
    return make_kinematic_plant(robot, disturbance=disturbance, **kwargs)


def simulator_of(system, context=None, step=0.01):
    simulator = Simulator(system) if context is None else Simulator(system, context)
    ResetIntegratorFromFlags(simulator, "runge_kutta3", step)
    simulator.get_mutable_integrator().set_fixed_step_mode(True)
    return simulator


def run(uvms, start, duration, zeta=None, w=None, step=0.01):
    """Returns 𝔮 at the end of a run."""
    simulator = simulator_of(uvms, step=step)
    context = simulator.get_mutable_context()
    context.SetContinuousState(start)
    for port, value in (("zeta", zeta), ("disturbance", w)):
        if value is not None:
            uvms.GetInputPort(port).FixValue(context, value)
    simulator.AdvanceTo(duration)
    return uvms.GetOutputPort("configuration").Eval(context).copy()


def rate(uvms, config, zeta=None, w=None):
    """Returns 𝔮̇."""
    context = uvms.CreateDefaultContext()
    context.SetContinuousState(config)
    for port, value in (("zeta", zeta), ("disturbance", w)):
        if value is not None:
            uvms.GetInputPort(port).FixValue(context, value)
    return uvms.EvalTimeDerivatives(context).CopyToVector()


@pytest.fixture
def bare(tmp_path) -> str:
    """A vehicle without an arm, with a tip that is neither at its origin nor along its axes."""
    folder = tmp_path / "bare"
    folder.mkdir()
    (folder / "bare.sdf").write_text(BARE)
    (folder / "package.xml").write_text("<package><name>bare</name></package>")
    (folder / "hydrodynamics.yaml").write_text("fluid_density: 1025.0\n")
    return str(folder)


def test_the_ports_have_the_names_and_sizes_of_the_docstring():
    for disturbance in (CALM, None):
        uvms = make(disturbance)
        assert uvms.get_name() == "uvms"
        inputs = [uvms.get_input_port(i) for i in range(uvms.num_input_ports())]
        outputs = [uvms.get_output_port(i) for i in range(uvms.num_output_ports())]
        expected = {"zeta": 10} | ({} if disturbance is CALM else {"disturbance": 6})
        assert {port.get_name(): port.size() for port in inputs} == expected
        assert {port.get_name(): port.size() for port in outputs} == {
            "configuration": 10, "state": 20, "disturbance": 6}
        assert uvms.num_continuous_states() == 10  # the MultibodyPlant is not simulated


def test_a_loaded_robot_is_the_one_of_its_name():
    w = np.full(6, 0.1)
    by_name, loaded = (rate(make(None, robot), START, ZETA, w)
                       for robot in (MODEL, Robot.load(MODEL)))
    np.testing.assert_array_equal(loaded, by_name)


def test_the_configuration_that_is_set_comes_out_also_inside_a_larger_diagram():
    builder = DiagramBuilder()
    uvms = builder.AddSystem(make())
    station = builder.Build()
    root = station.CreateDefaultContext()
    context = uvms.GetMyMutableContextFromRoot(root)
    context.SetContinuousState(START)
    np.testing.assert_array_equal(uvms.GetOutputPort("configuration").Eval(context), START)
    uvms.GetInputPort("zeta").FixValue(context, ZETA)
    np.testing.assert_array_equal(
        uvms.GetOutputPort("state").Eval(context), np.concatenate([START, ZETA]))


def test_what_is_not_connected_is_zero():
    uvms = make()
    context = uvms.CreateDefaultContext()
    context.SetContinuousState(START)
    np.testing.assert_array_equal(uvms.GetOutputPort("state").Eval(context)[10:], 0.0)
    np.testing.assert_array_equal(rate(uvms, START), 0.0)


def test_the_plants_jacobian_is_that_of_the_model_and_of_the_papers_table(model):
    kinematics = make().GetSubsystemByName("kinematics")
    context = kinematics.CreateDefaultContext()
    for config in dh.random_configurations(seed=0, count=30, tip_pitch=1.4):
        context.SetContinuousState(config)
        chi, J = kinematics.tip_motion(context)
        np.testing.assert_allclose(J, model.task_jacobian(config)[:6], atol=1e-11)
        np.testing.assert_allclose(
            wrap_angle(chi - model.task_pose(config)[:6]), 0.0, atol=1e-12)
        np.testing.assert_allclose(wrap_angle(chi - dh.chi(config)), 0.0, atol=1e-12)


def test_the_law_is_that_of_the_extended_task(model):
    """Γ[ζ + J_x⁻¹(w, 0)] with the whole J_x, and J_x of the other model."""
    rng = np.random.default_rng(1)
    uvms = make(None)
    for config in dh.random_configurations(seed=1, count=10, tip_pitch=1.3):
        zeta, w = rng.normal(size=10), rng.normal(size=6)
        J_x = model.task_jacobian(config)
        expected = configuration_rate(
            config, zeta + np.linalg.solve(J_x, np.concatenate([w, np.zeros(4)])))
        np.testing.assert_allclose(
            carried_rate(config, zeta, w, J_x[:6]), expected, atol=1e-11)
        np.testing.assert_allclose(rate(uvms, config, zeta, w), expected, atol=1e-10)


def test_the_end_effector_is_carried_by_w_and_the_joints_are_not():
    """χ by the paper's table, its rate by differences along 𝔮̇; ζ is zero."""
    uvms, h = make(None), 1e-6
    w = np.array([0.1, -0.2, 0.3, 0.05, -0.1, 0.2])
    q_dot = rate(uvms, START, w=w)
    np.testing.assert_array_equal(q_dot[6:], 0.0)
    chi_dot = (dh.chi(START + h * q_dot) - dh.chi(START - h * q_dot)) / (2.0 * h)
    np.testing.assert_allclose(chi_dot, w, atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_along_a_run_the_task_moves_with_j_zeta_and_w(model, kind):
    """ẏ by differences of fourth order of the logged 𝔮, ζ as a function of 𝔮."""
    builder, h = DiagramBuilder(), 0.005
    uvms = builder.AddSystem(make(KINDS[kind], seed=4))
    gain = builder.AddSystem(MatrixGain(-0.3 * np.eye(10)))
    builder.Connect(uvms.GetOutputPort("configuration"), gain.get_input_port())
    builder.Connect(gain.get_output_port(), uvms.GetInputPort("zeta"))
    sinks = [LogVectorOutput(uvms.GetOutputPort(name), builder, h)
             for name in ("state", "disturbance")]
    simulator = simulator_of(builder.Build(), step=h)
    root = simulator.get_mutable_context()
    uvms.GetMyMutableContextFromRoot(root).SetContinuousState(START)
    simulator.AdvanceTo(0.8)
    state, w = (sink.FindLog(root).data().T for sink in sinks)
    np.testing.assert_allclose(state[:, 10:], -0.3 * state[:, :10], atol=1e-15)
    y = model.task_pose(state[:, :10])
    y_dot = (8.0 * (y[3:-1] - y[1:-3]) - (y[4:] - y[:-4])) / (12.0 * h)
    expected = np.einsum("tij,tj->ti", model.task_jacobian(state[:, :10]), state[:, 10:])
    expected[:, :6] += w
    assert np.max(np.linalg.norm(w, axis=1)) > 0.1
    # The second derivative of the random kind jumps now and then.
    np.testing.assert_allclose(
        y_dot, expected[2:-2], atol=5e-5 if kind == "random" else 3e-6)


def screw(nu, time):
    """Returns the pose (4, 4) after a constant body velocity (v, ω) from the identity."""
    v, omega = nu[:3], nu[3:]
    speed = np.linalg.norm(omega)
    k, a = omega / speed, speed * time
    K = np.array([[0.0, -k[2], k[1]], [k[2], 0.0, -k[0]], [-k[1], k[0], 0.0]])
    X = np.eye(4)
    X[:3, :3] += np.sin(a) * K + (1.0 - np.cos(a)) * K @ K
    X[:3, 3] = (time * np.eye(3) + (1.0 - np.cos(a)) / speed * K
                + (a - np.sin(a)) / speed * K @ K) @ v
    return X


def test_a_constant_body_velocity_is_a_screw_motion_and_joints_go_straight():
    end = run(make(), START, 1.5, ZETA, step=0.005)
    X = dh.vehicle(START[:6]) @ screw(ZETA[:6], 1.5)
    np.testing.assert_allclose(dh.vehicle(end[:6]), X, atol=1e-7)
    np.testing.assert_allclose(end[6:], START[6:] + 1.5 * ZETA[6:], atol=1e-12)


def test_a_constant_w_moves_the_end_effector_on_a_straight_line_in_chi():
    w = np.array([0.1, -0.2, 0.3, 0.05, -0.1, 0.2])
    end = run(make(None), START, 1.5, w=w)
    np.testing.assert_allclose(dh.chi(end), dh.chi(START) + 1.5 * w, atol=1e-6)
    np.testing.assert_array_equal(end[6:], START[6:])


def test_a_motion_without_w_is_the_same_from_any_pose():
    X_WV = RigidTransform(RollPitchYaw(0.5, -0.3, 2.1), np.array([3.0, -5.0, 0.8]))
    moved = START.copy()
    moved[:6] = dh.pose_vector(X_WV.GetAsMatrix4() @ dh.vehicle(START[:6]))
    ends = [run(make(), start, 1.0, ZETA, step=0.005) for start in (START, moved)]
    np.testing.assert_allclose(
        dh.vehicle(ends[1][:6]), X_WV.GetAsMatrix4() @ dh.vehicle(ends[0][:6]), atol=1e-7)
    np.testing.assert_array_equal(ends[0][6:], ends[1][6:])


def test_a_motion_with_w_is_the_same_from_any_place_and_heading():
    """The first three of w are rotated; Euler rates stay."""
    turn, shift = 2.1, np.array([3.0, -5.0, 0.8])
    R = RollPitchYaw(0.0, 0.0, turn).ToRotationMatrix().matrix()
    w = np.array([0.1, -0.2, 0.3, 0.05, -0.1, 0.2])
    moved = START.copy()
    moved[:3], moved[5] = R @ START[:3] + shift, START[5] + turn
    still = run(make(None), START, 1.0, ZETA, w)
    end = run(make(None), moved, 1.0, ZETA, np.concatenate([R @ w[:3], w[3:]]))
    np.testing.assert_allclose(end[:3], R @ still[:3] + shift, atol=1e-12)
    np.testing.assert_allclose(end[3:] - still[3:], turn * np.eye(7)[2], atol=1e-12)


def test_a_vehicle_without_an_arm(bare):
    uvms, surface = make(None, bare), check_surface(UnilateralPlane())
    model = ContactModel.load(bare, surface)
    rng = np.random.default_rng(2)
    config, zeta, w = START[:6], rng.normal(size=6), rng.normal(size=6)
    kinematics = uvms.GetSubsystemByName("kinematics")
    context = kinematics.CreateDefaultContext()
    context.SetContinuousState(config)
    np.testing.assert_allclose(
        kinematics.tip_motion(context)[1], model.task_jacobian(config), atol=1e-12)
    np.testing.assert_allclose(rate(uvms, config, zeta, w), configuration_rate(
        config, zeta + np.linalg.solve(model.task_jacobian(config), w)), atol=1e-12)
    assert run(uvms, config, 0.1, zeta, w).shape == (6,)


def test_a_user_may_feed_back_the_configuration_without_an_algebraic_loop():
    """A static feedback of 𝔮, and a static disturbance of the output (𝔮, ζ)."""
    builder = DiagramBuilder()
    uvms = builder.AddSystem(make(None))
    gain = builder.AddSystem(MatrixGain(-0.5 * np.eye(10)))
    push = builder.AddSystem(MatrixGain(0.01 * np.eye(6, 20)))
    builder.Connect(uvms.GetOutputPort("configuration"), gain.get_input_port())
    builder.Connect(gain.get_output_port(), uvms.GetInputPort("zeta"))
    builder.Connect(uvms.GetOutputPort("state"), push.get_input_port())
    builder.Connect(push.get_output_port(), uvms.GetInputPort("disturbance"))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    uvms.GetMyMutableContextFromRoot(context).SetContinuousState(START)
    state = uvms.GetOutputPort("state").Eval(uvms.GetMyContextFromRoot(context))
    np.testing.assert_array_equal(state[10:], -0.5 * START)
    feeds = {(uvms.get_input_port(i).get_name(), uvms.get_output_port(j).get_name())
             for i in range(2) for j in range(3) if uvms.HasDirectFeedthrough(i, j)}
    assert feeds == {("zeta", "state"), ("disturbance", "disturbance")}


def test_a_cloned_context_continues_identically():
    uvms = make(KINDS["random"], seed=3)
    simulator = simulator_of(uvms)
    context = simulator.get_mutable_context()
    context.SetContinuousState(START)
    uvms.GetInputPort("zeta").FixValue(context, ZETA)
    simulator.AdvanceTo(0.4)
    twin = simulator_of(uvms, context.Clone())
    for each in (twin, simulator):
        each.AdvanceTo(1.0)
    port = uvms.GetOutputPort("configuration")
    np.testing.assert_array_equal(port.Eval(context), port.Eval(twin.get_context()))


def test_the_seed_decides_the_disturbance():
    ends = [run(make(KINDS["random"], seed=seed), START, 0.3) for seed in (3, 3, 4)]
    np.testing.assert_array_equal(ends[0], ends[1])
    assert not np.allclose(ends[0], ends[2])


def test_joint_limits_are_no_end_stops_and_raise_no_warning(caplog):
    end = run(make(), START, 1.0, np.eye(10)[7])
    assert not caplog.records
    assert end[7] == pytest.approx(START[7] + 1.0)
    assert end[7] > dh.UPPER[1]


@pytest.mark.parametrize(("owner", "start", "speed"), [
    ("vehicle", np.array([0, 0, 0, 0, 1.0, 0.4, 0, 0.3, 0.1, 0]), 1.0),
    ("end-effector", np.array([0, 0, 0, 0, 0, 0.4, 0, 0.3, 0.1, 0]), -1.0)])
def test_near_the_singularity_of_euler_angles_the_run_fails_in_one_line(owner, start, speed):
    with pytest.raises(RunFailed, match=rf"^at t = .* s the pitch of the {owner} is "
                       r"-?1\.5\d* rad: Euler angles are singular at ±π/2$"):
        run(make(), start, 3.0, speed * np.eye(10)[4])


def test_the_margin_of_the_singularity(model):
    tip = np.zeros(10)  # where the arm of this robot points straight down
    assert abs(model.task_pose(tip)[4]) == pytest.approx(0.5 * np.pi)
    for pitch in (0.0, 0.9 * PITCH_MARGIN):
        with pytest.raises(RunFailed, match="end-effector"):
            rate(make(), tip + pitch * np.eye(10)[4])
    assert np.all(np.isfinite(rate(make(), tip + 1.1 * PITCH_MARGIN * np.eye(10)[4], ZETA)))


def test_an_input_that_is_not_finite_fails_in_one_line():
    for zeta, w, name in ((np.nan * ZETA, np.zeros(6), "commanded velocity"),
                          (ZETA, np.full(6, np.inf), "disturbance")):
        with pytest.raises(RunFailed, match=f"^at t = 0 s the {name} is not finite$"):
            rate(make(None), START, zeta, w)


@pytest.mark.parametrize(("kwargs", "message"), [
    ({"disturbance": ConstantDisturbance(-0.1)},
     r"^disturbance\.bound = -0\.1: must be zero or positive$"),
    ({"disturbance": ConstantDisturbance(0.1, np.ones(10))},
     r"^disturbance\.direction = .*: must be 6 finite numbers$"),
    ({"seed": -2}, r"^seed = -2: must be zero or positive$"),
    ({"robot": "nautilus"}, r"^model = 'nautilus': must be one of ")])
def test_bad_parameters_are_named(kwargs, message):
    with pytest.raises(InvalidParameter, match=message):
        make(**kwargs)


def test_a_configuration_of_the_wrong_size_is_named():
    with pytest.raises(InvalidParameter, match=r"^start = .*: must be 10 finite numbers$"):
        make(start=np.zeros(20))


def test_a_default_context_is_at_the_start():
    uvms = make(start=START)
    context = uvms.CreateDefaultContext()
    np.testing.assert_array_equal(uvms.GetOutputPort("configuration").Eval(context), START)
