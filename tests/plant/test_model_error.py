"""Scaled parameters and their factors, dry joints, and a payload that a wrist sensor feels."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from support.robots import FIELD_CASES
from support.runs import simulated
from support.true_model import model_with_error

import uvms_drake as uv
from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.signals.sensor_actuator import PAYLOAD, PAYLOAD_AT_REST
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.uvms import add_uvms
from uvms_drake.model.uvms_model import read_uvms
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.plant.joint_friction import STRIBECK, JointFriction, friction_torque
from uvms_drake.plant.model_error import (
    AxisFactors,
    ModelError,
    add_simulated_uvms,
    scaled_added_mass,
)
from uvms_drake.plant.payload import Payload, holding_wrench
from uvms_drake.station.step_size import friction_rate

ROBOT = "girona500_arm5e"
LEVEL = np.array([-3.0, 0.0, 0.0, 0.0, 0.0, 0.3, 0.1, 0.9, 0.4, 0.2])


@pytest.fixture(scope="module")
def load(plane):
    return lambda error=None: model_with_error(ROBOT, check_surface(plane), error)


def mass_matrix(model):
    return model.mass_matrix(model.kinematics(LEVEL))


def force_at_rest(model, config=LEVEL):
    return model.inverse_dynamics(model.kinematics(config), np.zeros(10), np.zeros(10))


def test_no_error_is_the_same_robot(load):
    np.testing.assert_array_equal(mass_matrix(load(ModelError())), mass_matrix(load()))
    np.testing.assert_allclose(force_at_rest(load(ModelError())), force_at_rest(load()), atol=1e-9)
    assert ModelError(share=0.5).size == 0.0
    assert ModelError(drag=0.8, mass=1.1).size == pytest.approx(0.2)


def test_the_inertia_is_what_the_two_masses_make_of_it(load):
    """It is linear in both, but for the reflected inertia of the motors, which has no error."""
    whole = mass_matrix(load())
    dry = mass_matrix(load(ModelError(mass=2.0))) - whole
    wet = mass_matrix(load(ModelError(added_mass=2.0))) - whole
    both = mass_matrix(load(ModelError(mass=1.1, added_mass=0.8)))
    np.testing.assert_allclose(both, whole + 0.1 * dry - 0.2 * wet, atol=1e-9)
    assert dry[0, 0] > 180.0
    assert wet[0, 0] > 100.0


def test_the_trim_scales_with_the_mass_and_the_lever_turns(load):
    weight = force_at_rest(load())
    np.testing.assert_allclose(force_at_rest(load(ModelError(mass=1.2))), 1.2 * weight, atol=1e-6)
    rolled = LEVEL + np.eye(10)[3] * 0.1
    stiffer = force_at_rest(load(ModelError(buoyancy_lever=1.5)), rolled)
    np.testing.assert_allclose(stiffer[:3], force_at_rest(load(), rolled)[:3], atol=1e-9)
    assert stiffer[3] > force_at_rest(load(), rolled)[3] + 5.0  # N m, to hold the roll


def test_drag_is_all_that_changes_with_the_drag(load):
    zeta = np.repeat([0.2, 0.1, 0.3], [3, 3, 4])

    def force(error, speed):
        model = load(error)
        return model.inverse_dynamics(model.kinematics(LEVEL), speed, np.zeros(10))

    off = ModelError(drag=1.3)
    np.testing.assert_allclose(force(off, 0.0 * zeta), force(None, 0.0 * zeta), atol=1e-9)
    assert force(off, zeta)[0] > force(None, zeta)[0] + 1.0


def test_factors_by_axis_multiply_what_is_of_that_axis_and_one_number_is_all_of_them(load):
    """In the vehicle's own axes, of one whose arm has no water; the rest stays as it is."""
    known = load()
    whole, rows = mass_matrix(known), known.links.drag_linear
    factors = np.array([1.5, 1.0, 1.0, 2.0, 1.0, 0.5])
    off = mass_matrix(load(ModelError(vehicle=AxisFactors(added_mass=factors)))) - whole
    M = np.diag([110.0, 110.0, 110.0, 22.0, 38.0, 32.0])  # Entrained water, and the hull's.
    hull = read_uvms(ROBOT).hydrodynamics.bodies["vehicle"].added_mass[0].matrix
    assert off[0, 0] == pytest.approx(0.5 * (M[0, 0] + hull[0, 0]))
    assert off[0, 1] == pytest.approx(0.25 * hull[0, 1])  # The mean of both factors.
    assert np.all(off[6:] == 0.0)
    drag = AxisFactors(linear_drag=np.array([2.0, 1.0, 1.0, 1.0, 1.0, 1.0]))
    np.testing.assert_allclose(
        load(ModelError(vehicle=drag)).links.drag_linear[:6], rows[:6] * [2, 1, 1, 1, 1, 1])
    every = AxisFactors(*np.full((3, 1), 1.2))
    both = load(ModelError(vehicle=every, arm=every))
    shorthand = load(ModelError(added_mass=1.2, drag=1.2))
    np.testing.assert_allclose(mass_matrix(both), mass_matrix(shorthand), atol=1e-9)
    np.testing.assert_allclose(both.links.drag_quadratic, shorthand.links.drag_quadratic)


def test_no_factors_make_an_added_mass_that_no_body_can_have():
    coupled = np.array([[4.0, 1.99], [1.99, 1.0]])
    M = np.eye(6)
    M[:2, :2] = coupled
    with pytest.raises(InvalidParameter, match=r"added_mass = .*: must be factors by which"):
        scaled_added_mass(M, np.array([3.0, 1.0, 1.0, 1.0, 1.0, 1.0]))


BALL = Payload(mass=0.7, displaced=0.3, centre=np.array([0.02, -0.03, 0.1]))


def test_a_payload_is_a_ball_of_its_mass_that_moves_with_the_tip(load):
    """By virtual work and by kinetic energy, with the velocity of its centre."""
    known, held = load(), load(ModelError(payload=BALL))
    kinematics = known.kinematics(LEVEL)
    R, J = kinematics.A_E[:3, :3], np.linalg.solve(kinematics.A_E, kinematics.J_chi)
    lever = np.cross(np.eye(3), BALL.centre).T
    at_centre = R @ (J[:3] + lever @ J[3:])
    weight = (BALL.mass - BALL.displaced) * 9.81 * np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(
        force_at_rest(held) - force_at_rest(known), -at_centre.T @ weight, atol=1e-9)
    radius = np.cbrt(3.0 * BALL.displaced / 1000.0 / (4.0 * np.pi))
    extra = ((BALL.mass + 0.5 * BALL.displaced) * at_centre.T @ at_centre
             + 0.4 * BALL.mass * radius**2 * J[3:].T @ J[3:])
    np.testing.assert_allclose(mass_matrix(held) - mass_matrix(known), extra, atol=1e-9)


def test_what_is_not_trimmed_floats_or_sinks_and_tilts(load):
    weight = force_at_rest(load())
    floated = force_at_rest(load(ModelError(buoyancy=1.02))) - weight
    assert floated[2] == pytest.approx(0.02 * (183.8 + 7.244) * 9.81, rel=1e-3)
    shifted = force_at_rest(load(ModelError(buoyancy_shift=np.array([0.01, 0.02, 0.0])))) - weight
    buoyancy = 183.8 * 9.81
    np.testing.assert_allclose(
        shifted[:6], [0.0, 0.0, 0.0, 0.02 * buoyancy, -0.01 * buoyancy, 0.0], atol=1e-6)


@pytest.mark.parametrize("factor", [0.7, 1.0851482])
def test_a_robot_of_a_urdf_can_have_another_mass(factor):
    """Each link's mass and moments are those that an XML reader finds in the file, scaled."""
    robot = FIELD_CASES / "campaign_of_a_urdf" / "box_urdf"
    plant = MultibodyPlant(0.0)
    uvms = add_simulated_uvms(plant, str(robot), ModelError(mass=factor))
    links = ElementTree.parse(robot / "box_urdf.urdf").getroot().findall("link")
    assert len(links) == 3
    for link in links:
        body = plant.GetBodyByName(link.get("name"))
        mass = float(link.find("inertial/mass").get("value"))
        moments = [float(link.find("inertial/inertia").get(key)) for key in ("ixx", "iyy", "izz")]
        found = body.default_spatial_inertia()
        assert body.default_mass() == pytest.approx(factor * mass, rel=1e-12)
        central = found.Shift(found.get_com()).CalcRotationalInertia().get_moments()
        np.testing.assert_allclose(central, factor * np.array(moments), rtol=1e-9)
    # The volume is scaled with it: the robot is trimmed before it dives.
    known = add_uvms(MultibodyPlant(0.0), str(robot)).hydrodynamics.bodies
    for name, body in uvms.hydrodynamics.bodies.items():
        assert body.displaced_volume == pytest.approx(factor * known[name].displaced_volume)


WHOLE = """<link name="vehicle"><inertial><mass>3</mass><inertia><ixx>1</ixx><iyy>1</iyy>
  <izz>1</izz><ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia></inertial></link>"""
ARM = """<robot name="arm"><link name="upper"><inertial><mass value="2"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""


@pytest.mark.parametrize(("rest", "body"), [
    ("", ""),
    ("<include merge='true'><uri>package://diver/arm.urdf</uri></include>", ""),
    ("<link name='base'/>", "base")])
def test_a_mass_that_is_written_nowhere_is_not_scaled_by_halves(
        tmp_path, rest, body):
    """It would leave the inertia of a link as it is, but not its volume."""
    folder = tmp_path / "diver"
    folder.mkdir()
    (folder / "diver.sdf").write_text(
        f'<sdf version="1.9"><model name="diver">{WHOLE}{rest}'
        '<frame name="tip" attached_to="vehicle"/></model></sdf>')
    (folder / "arm.urdf").write_text(ARM)
    (folder / "hydrodynamics.yaml").write_text("{}")
    (folder / "package.xml").write_text("<package><name>diver</name></package>")
    add_simulated_uvms(MultibodyPlant(0.0), str(folder), ModelError(drag=1.1))
    if not body:
        plant = MultibodyPlant(0.0)
        add_simulated_uvms(plant, str(folder), ModelError(mass=1.1))
        assert plant.GetBodyByName("vehicle").default_mass() == pytest.approx(3.3)
        assert not rest or plant.GetBodyByName("upper").default_mass() == pytest.approx(2.2)
        return
    with pytest.raises(uv.InvalidParameter,
                       match=rf"^model_error\.mass = 1\.1: must be 1 .* '{body}' by numbers"):
        add_simulated_uvms(MultibodyPlant(0.0), str(folder), ModelError(mass=1.1))


FRICTION = JointFriction(coulomb=np.array([0.5, 2.0]), static=np.array([0.8, 1.0]))
CONFIG = np.array([-3.0, 0.0, 0.0, 0.1, -0.2, 0.3, 0.1, 0.9, 0.4, 0.2])


def test_it_is_coulombs_torque_against_a_fast_joint_and_the_static_one_at_break_away():
    for sign in (1.0, -1.0):
        np.testing.assert_allclose(friction_torque(FRICTION, sign * np.array([9.0, 0.5])),
                                   -sign * np.array([0.5, 2.0]), rtol=1e-12)
        np.testing.assert_allclose(friction_torque(FRICTION, sign * np.full(2, FRICTION.creep)),
                                   -sign * np.array([0.8, 2.0]), rtol=1e-12)
    one = friction_torque(FRICTION, np.array([FRICTION.creep + STRIBECK, 0.0]))
    np.testing.assert_allclose(one, [-(0.5 + 0.3 * np.exp(-1.0)), 0.0], rtol=1e-12)


def test_it_takes_power_and_has_no_jump_and_no_steeper_slope_than_is_said():
    rates = np.linspace(-0.3, 0.3, 60001)
    torque = friction_torque(FRICTION, np.stack([rates, rates], axis=1))
    assert np.all(torque * rates[:, None] <= 0.0)
    assert np.max(np.abs(torque)) <= FRICTION.largest + 1e-12
    slopes = np.max(np.abs(np.diff(torque, axis=0)), axis=0) / (rates[1] - rates[0])
    np.testing.assert_allclose(slopes, FRICTION.slopes(2), rtol=1e-3)


def plant_with(friction):
    uvms = uv.make_uvms_plant("girona500_arm5e", surface=None, disturbance=ConstantDisturbance(),
                           error=ModelError(joint_friction=friction))
    simulator = Simulator(uvms)
    ResetIntegratorFromFlags(simulator, "runge_kutta3", 2e-3)
    simulator.get_mutable_integrator().set_fixed_step_mode(True)
    return uvms, simulator, simulator.get_mutable_context()


def acceleration(uvms, context, zeta, tau):
    uv.set_state(uvms, context, np.concatenate([CONFIG, zeta]))
    uvms.GetInputPort("tau").FixValue(context, tau)
    return uvms.GetOutputPort("acceleration").Eval(context).copy()


def test_the_robot_feels_it_as_a_torque_of_its_joints(model):
    """The same acceleration as without friction under τ less by it."""
    friction = JointFriction(coulomb=np.array([0.5, 1.0, 1.5, 2.0]))
    rng = np.random.default_rng(2)
    dry, wet = plant_with(friction), plant_with(JointFriction())
    for _ in range(3):
        zeta, tau = 0.2 * rng.normal(size=10), rng.normal(size=10)
        torque = np.append(np.zeros(6), friction_torque(friction, zeta[6:]))
        np.testing.assert_allclose(acceleration(dry[0], dry[2], zeta, tau),
                                   acceleration(wet[0], wet[2], zeta, tau + torque), atol=1e-10)


def test_a_joint_sticks_below_the_static_torque_and_breaks_away_above_it(model):
    """The torque of the equilibrium holds the others; a joint that sticks creeps."""
    friction, duration = JointFriction(np.array([1.0]), np.array([2.0]), creep=0.05), 0.2
    rest = model.inverse_dynamics(model.kinematics(CONFIG), np.zeros(10), np.zeros(10))
    turned = []
    for push in (1.8, 2.6):
        uvms, simulator, context = plant_with(friction)
        uv.set_state(uvms, context, np.concatenate([CONFIG, np.zeros(10)]))
        uvms.GetInputPort("tau").FixValue(context, rest + push * np.eye(10)[9])
        simulator.AdvanceTo(duration)
        turned.append(uvms.GetOutputPort("state").Eval(context)[9] - CONFIG[9])
    assert 0.0 < turned[0] <= friction.creep * duration
    assert turned[1] > 5.0 * friction.creep * duration


def test_its_rate_is_that_of_the_loops_own_acceleration_by_the_rates():
    scenario = uv.load_scenario("girona500_ideal")
    model = uv.load_model(scenario)
    friction = JointFriction(coulomb=np.array([0.3, 0.2, 0.1, 0.05]))
    scenario.model_error = replace(scenario.model_error, joint_friction=friction)
    rate = friction_rate(scenario, model, CONFIG)
    M, zeta = model.mass_matrix(model.kinematics(CONFIG)), 0.5 * friction.creep * np.eye(10)[9]
    slope = [np.linalg.solve(M, np.append(np.zeros(6), friction_torque(
        friction, zeta[6:] + h * np.eye(4)[3]))) for h in (1e-7, -1e-7)]
    assert abs(slope[0] - slope[1])[9] / 2e-7 == pytest.approx(rate, rel=0.05)
    assert friction_rate(uv.load_scenario("girona500_ideal"), model, CONFIG) == 0.0


G = np.array([0.0, 0.0, 9.81])
HEAVY = Payload(mass=1.5, displaced=0.5, centre=np.array([0.02, -0.03, 0.1]))


def holding(payload):
    return uv.make_uvms_plant(ROBOT, surface=None, disturbance=None,
                              error=None if payload is None else ModelError(payload=payload))


def states(count: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    config = np.concatenate([rng.normal(size=(count, 3)), rng.uniform(-1.0, 1.0, (count, 3)),
                             rng.uniform(0.1, 0.5, (count, 4))], axis=1)
    return np.concatenate([config, 0.5 * rng.normal(size=(count, 10))], axis=1)


# The law -----------------------------------------------------------------------------------------


def test_at_rest_it_is_the_weight_in_water_in_any_attitude():
    for rpy in np.random.default_rng(0).uniform(-1.5, 1.5, (20, 3)):
        g = rotation_matrix(rpy).T @ G
        found = holding_wrench(HEAVY, 1000.0, np.zeros(6), np.zeros(3), g, np.zeros(3))
        np.testing.assert_allclose(found[:3], -1.0 * g, atol=1e-12)
        np.testing.assert_allclose(found[3:], np.cross(HEAVY.centre, -1.0 * g), atol=1e-12)


@pytest.mark.parametrize("mass", [1.5, 0.3])
def test_no_motion_within_its_bounds_takes_more_than_the_largest_wrench(mass):
    """Accelerations and water at random, many at their bounds, all along gravity in one case."""
    ball = Payload(mass=mass, displaced=0.5, centre=HEAVY.centre, acceleration=3.0)
    force, moment = ball.largest_hold(1000.0, 9.81, 0.2)
    rng, found, radius = np.random.default_rng(2), [], ball.radius(1000.0)
    for i in range(200):
        g, a, water, turn = (size * each / np.linalg.norm(each) for size, each in zip(
            (9.81, 3.0, 0.2, 3.0 / radius), rng.normal(size=(4, 3)), strict=True))
        if i == 0:
            a, water = (size * np.sign(mass - 0.5) * g / 9.81 for size in (-3.0, 0.2))
        # The end-effector accelerates as the centre does, less what its turning adds.
        found.append(holding_wrench(ball, 1000.0, np.append(
            a - np.cross(turn, ball.centre), turn), np.zeros(3), g, water))
    norms = np.linalg.norm(np.reshape(found, (-1, 2, 3)), axis=-1)
    assert np.max(norms[:, 0]) == pytest.approx(force)
    assert 0.8 * moment < np.max(norms[:, 1]) <= moment


def test_its_inertia_is_that_of_a_ball_with_half_of_its_water():
    """Swung in a circle, shaken, and turned about its own centre; in air and in water."""
    none, c = np.zeros(3), np.array([0.1, 0.0, 0.0])
    swung = holding_wrench(Payload(2.0, 0.6, c), 1000.0, np.zeros(6), np.array([0.0, 0.0, 3.0]),
                           none, none)
    np.testing.assert_allclose(swung, [-(2.0 + 0.3) * 0.1 * 9.0, 0, 0, 0, 0, 0], atol=1e-12)
    turned = holding_wrench(Payload(2.0, 0.6), 1000.0, np.array([0, 0, 0, 5.0, 0, 0]), none, none,
                            none)
    radius = np.cbrt(0.6e-3 / (4.0 / 3.0 * np.pi))
    np.testing.assert_allclose(turned, [0, 0, 0, 0.4 * 2.0 * radius**2 * 5.0, 0, 0], atol=1e-12)
    # Neutral, and carried along by accelerating water: nothing has to hold it.
    along = np.array([0.3, -0.2, 0.1])
    carried = holding_wrench(Payload(0.7, 0.7), 1000.0, np.append(along, none), none, G, along)
    np.testing.assert_allclose(carried, np.zeros(6), atol=1e-12)


# The plant ---------------------------------------------------------------------------------------


def test_the_hand_pays_for_what_it_holds():
    """Newton and d'Alembert: the plant with the payload moves as the one without, pulled by it.

    In random states and under random forces, in accelerating water; the payload's reaction on the
    end-effector, by the Jacobian of its own velocity, is all of the difference.
    """
    held, free = holding(HEAVY), holding(None)
    contexts = [each.CreateDefaultContext() for each in (held, free)]
    rng = np.random.default_rng(2)
    model = uv.UvmsModel(uv.read_uvms(ROBOT))
    for state in states(6):
        # Within the limits of the motors: beyond them the inertia of the joint counts.
        state[16:] *= 0.1
        tau, water = rng.normal(size=10) * np.repeat([30.0, 3.0], [6, 4]), rng.normal(size=3)
        for plant, context in zip((held, free), contexts, strict=True):
            uv.set_state(plant, context, state)
            plant.GetInputPort("tau").FixValue(context, tau)
            plant.GetInputPort("disturbance").FixValue(context, np.zeros(10))
            plant.GetInputPort("current_acceleration").FixValue(context, water)
        zeta_dot = held.GetOutputPort("acceleration").Eval(contexts[0])
        wrench = held.GetOutputPort(PAYLOAD).Eval(contexts[0])
        at = model.kinematics(state[:10])
        reaction = -np.linalg.solve(at.A_E, at.J_chi).T @ wrench
        coordinates = free.GetSubsystemByName("to_paper_order").coordinates
        free.GetInputPort("applied_generalized_force").FixValue(
            contexts[1], coordinates.vector_to_drake(
                free.GetOutputPort("plant_state").Eval(contexts[1]), reaction))
        np.testing.assert_allclose(free.GetOutputPort("acceleration").Eval(contexts[1]), zeta_dot,
                                   rtol=1e-8, atol=1e-8)
        rest = held.GetOutputPort(PAYLOAD_AT_REST).Eval(contexts[0])
        R_WE = rotation_matrix(state[3:6]) @ at.R_BL[-1]
        np.testing.assert_allclose(rest[:3], R_WE.T @ (-1.0 * G), atol=1e-9)


# The sensor --------------------------------------------------------------------------------------

def recorded(lag=0.0, tare=0.0):
    """Returns the record of a short run with a payload; the sensor is mounted aslant."""
    none = "[0, 0, 0, 0, 0, 0]"
    return simulated(
        "girona500_ideal", 0.4, "model_error.payload={mass: 1.5, displaced: 0.5, "
        "centre: [0, 0, 0.1]}", f"sensing=[!ForceSensor {{noise: {none}, resolution: {none}, "
        f"bias: {none}, drift: {none}, lag: {lag}, tare: {tare}, "
        "mounting: [0.02, -0.03, -0.11, 0.4, -0.7, 2.1]}]")


def test_the_field_case_reads_what_hangs_at_the_tip():
    """(0, 0, −9.81) N of weight, 1 kg less its water, and 1.75 kg times the tip's acceleration.

    The acceleration is by second differences of the tip's logged positions.
    """
    log = uv.simulate(uv.load_scenario(str(FIELD_CASES / "payload_not_felt" / "felt.yaml")))
    tip, rest = log.chi[:, :3], log.signals[PAYLOAD_AT_REST][5]
    np.testing.assert_allclose(
        rotation_matrix(log.chi[5, 3:]) @ rest[:3], [0.0, 0.0, -9.81], atol=1e-9)
    accelerations = (tip[6] - 2.0 * tip[5] + tip[4]) / log.time[1]**2
    assert np.linalg.norm(accelerations) > 0.3  # It is felt.
    np.testing.assert_allclose(log.signals["force_measured"][5, :3], np.array(
        [0.0, 0.0, -9.81]) + 1.75 * accelerations, atol=0.05)


def test_it_reads_the_weight_and_the_inertia_in_its_own_axes():
    """Every sample is the wrench at its instant, moved to the sensor by hand."""
    record = recorded()
    R = rotation_matrix(np.array([0.4, -0.7, 2.1]))
    p = np.array([0.02, -0.03, -0.11])
    wrench, reading = record.signals[PAYLOAD], record.signals["force_raw"]
    force = wrench[:, :3] @ R
    moment = (wrench[:, 3:] - np.cross(p, wrench[:, :3])) @ R
    # A sample is read before a command changes; in between all is smooth.
    off = np.abs(reading - np.concatenate([force, moment], axis=1))[2:]
    assert np.median(off[:, :3]) < 0.05
    assert np.median(off[:, 3:]) < 0.005
    assert np.min(np.linalg.norm(reading[2:, :3], axis=1)) > 5.0


@pytest.mark.parametrize("lag", [0.0, 0.02])
def test_a_tare_takes_off_the_weight_but_not_its_turning(lag):
    """What is left after the tare is small; without it, all of the weight is read."""
    tared, whole = recorded(lag, 0.2), recorded(lag)
    late = tared.time > 0.25
    left, read = (np.linalg.norm(each.signals["force_raw"][late, :3], axis=1)
                  for each in (tared, whole))
    assert np.max(left) < 3.0
    assert np.min(read) > 7.0
