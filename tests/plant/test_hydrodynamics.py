"""The water's forces, waves, and the acceleration they leave, against closed forms.

Tests are written in a frame I with z down. `X_WI` puts I into World, once upright and once turned
and moved, so that mistakes of frame cannot cancel; gravity turns with it.
"""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import DiscreteContactApproximation
from pydrake.systems.analysis import Simulator
from support.tank import INERTIA, MASS, G, Tank, joint, link, random_added_mass, robot

from uvms_drake.model.description.hydrodynamics_file import (
    AddedMass,
    BodyHydrodynamics,
    Drag,
    HydrodynamicParameters,
)
from uvms_drake.plant.waves import Wave, largest_speed, water_motion

VOLUME, DENSITY = 0.0024, 1025.0  # m³, kg/m³


@pytest.fixture(params=[
    RigidTransform(),
    RigidTransform(RollPitchYaw(0.7, -0.4, 2.1), np.array([3.0, -5.0, 0.8])),
], ids=["upright", "turned and moved"])
def X_WI(request):
    return request.param


def robot_water(drag: bool = True, buoyancy: bool = True) -> HydrodynamicParameters:
    random = np.random.default_rng(3)
    return HydrodynamicParameters(DENSITY, {
        name: BodyHydrodynamics(
            displaced_volume=0.0016 * (i + 1) if buoyancy else 0.0,
            center_of_buoyancy=random.normal(scale=0.1, size=3),
            added_mass=[AddedMass(random_added_mass(i), random.normal(scale=0.2, size=3))],
            drag=[Drag(random.uniform(1, 3, 6), random.uniform(1, 3, 6),
                       random.normal(scale=0.2, size=3)) for _ in range(2) if drag])
        for i, name in enumerate(("vehicle", "lower", "upper"))})


def one_body(**kwargs) -> HydrodynamicParameters:
    return HydrodynamicParameters(DENSITY, {"vehicle": BodyHydrodynamics(**kwargs)})


def sphere(volume=VOLUME, **kwargs) -> HydrodynamicParameters:
    half = 0.5 * DENSITY * volume
    return one_body(displaced_volume=volume,
                    added_mass=[AddedMass(np.array([half, half, half, 0, 0, 0]))], **kwargs)


TILTED = RigidTransform(RollPitchYaw(0.4, 0.9, -1.3), np.array([0.3, 0.2, -4.0]))
ROBOT_STATE = {"nu": [0.4, -0.3, 0.2, 0.5, -0.6, 0.7], "X_IB": TILTED, "q": [0.3, -0.8],
               "q_dot": [0.9, -1.1]}


# One body ----------------------------------------------------------------------------------------


def test_a_sphere_released_in_water_accelerates_with_half_its_displaced_mass_added(X_WI):
    tank = Tank(sphere(), X_WI=X_WI)
    tank.set(np.zeros(6), TILTED)
    a = (MASS - DENSITY * VOLUME) * G / (MASS + 0.5 * DENSITY * VOLUME)
    a_I = X_WI.rotation().matrix().T @ tank.v_dot()[3:]
    np.testing.assert_allclose(a_I, [0.0, 0.0, a], atol=1e-13)
    np.testing.assert_allclose(tank.v_dot()[:3], 0.0, atol=1e-13)


def test_a_sinking_sphere_reaches_the_speed_at_which_drag_balances_weight_in_water(X_WI):
    linear, quadratic = 6.0, 19.0
    drag = Drag(np.array([linear] * 3 + [0.1] * 3), np.array([quadratic] * 3 + [0.1] * 3))
    tank = Tank(sphere(drag=[drag]), X_WI=X_WI)
    weight = (MASS - DENSITY * VOLUME) * G
    speed = (-linear + np.sqrt(linear**2 + 4.0 * quadratic * weight)) / (2.0 * quadratic)
    tank.set([0.0, 0.0, speed, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(tank.nu_dot(), 0.0, atol=1e-13)
    tank.set(np.zeros(6))
    tank.simulate(6.0)
    np.testing.assert_allclose(tank.nu(), [0.0, 0.0, speed, 0.0, 0.0, 0.0], atol=1e-9)


def test_a_buoyant_body_feels_its_buoyancy_at_the_centre_of_buoyancy(X_WI):
    center = np.array([0.05, -0.02, -0.11])
    tank = Tank(one_body(displaced_volume=MASS / DENSITY, center_of_buoyancy=center), X_WI=X_WI)
    tank.set(np.zeros(6), TILTED)
    up_B = TILTED.rotation().matrix().T @ [0.0, 0.0, -MASS * G]
    expected = np.cross(center, up_B) / INERTIA
    np.testing.assert_allclose(tank.nu_dot(), [0.0, 0.0, 0.0, *expected], atol=1e-12)


def test_an_elongated_body_at_an_angle_feels_the_munk_moment(X_WI):
    X, Y, N = 0.8, 3.9, 0.6
    tank = Tank(one_body(added_mass=[AddedMass(np.array([X, Y, Y, 0.1, 0.5, N]))]), X_WI=X_WI,
                gravity=np.zeros(3))
    u, v = 1.3, 0.4
    tank.set([u, v, 0.0, 0.0, 0.0, 0.0], TILTED)
    moment = -(Y - X) * u * v
    np.testing.assert_allclose(
        tank.nu_dot(), [0.0, 0.0, 0.0, 0.0, 0.0, moment / (INERTIA[2] + N)], atol=1e-13)


def test_drag_acts_at_its_point(X_WI):
    """A strip at r, turning with ω about z, has the lever r both for its speed and its moment."""
    r, omega, linear, quadratic = 0.7, -1.3, 2.0, 5.0
    strip = Drag(np.array([0, linear, 0, 0, 0, 0]), np.array([0, quadratic, 0, 0, 0, 0]),
                 np.array([r, 0.0, 0.0]))
    tank = Tank(one_body(drag=[strip]), X_WI=X_WI, gravity=np.zeros(3))
    tank.set([0.0, 0.0, 0.0, 0.0, 0.0, omega], TILTED)
    force = -(linear + quadratic * abs(r * omega)) * r * omega
    np.testing.assert_allclose(
        tank.nu_dot(), [0.0, force / MASS, 0.0, 0.0, 0.0, r * force / INERTIA[2]], atol=1e-13)


def S(a):
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def fossen_coriolis(M, nu):
    """Returns C(ν) of Fossen (2021, chapter 3): a skew-symmetric form for any 6×6 inertia."""
    s1 = S(M[:3, :3] @ nu[:3] + M[:3, 3:] @ nu[3:])
    s2 = S(M[3:, :3] @ nu[:3] + M[3:, 3:] @ nu[3:])
    return np.block([[np.zeros((3, 3)), -s1], [-s1, -s2]])


def test_a_free_body_obeys_fossens_matrix_equation(X_WI):
    """(M_RB + M_A) ν̇ + C_RB(ν) ν + C_A(ν_r) ν_r − M_A ν̇_c = f, off-centre, in a current."""
    com, M_A = np.array([0.12, -0.07, 0.21]), random_added_mass(1)
    tank = Tank(one_body(added_mass=[AddedMass(M_A)]), link("vehicle", MASS, com), X_WI,
                gravity=np.zeros(3))
    nu = np.array([0.7, -0.4, 0.9, 1.1, -0.8, 0.6])
    current_I = np.array([0.3, -0.2, 0.5])
    f = np.array([4.0, -3.0, 2.0, 0.7, 1.3, -0.9])
    tank.set(nu, TILTED)
    tank.fix_current(current_I)
    tank.fix_force(f)

    M_RB = np.block([[MASS * np.eye(3), -MASS * S(com)],
                     [MASS * S(com), np.diag(INERTIA) - MASS * S(com) @ S(com)]])
    nu_c = np.concatenate([TILTED.rotation().matrix().T @ current_I, np.zeros(3)])
    nu_c_dot = np.concatenate([-np.cross(nu[3:], nu_c[:3]), np.zeros(3)])
    nu_r = nu - nu_c
    expected = np.linalg.solve(M_RB + M_A, f + M_A @ nu_c_dot - fossen_coriolis(M_RB, nu) @ nu
                               - fossen_coriolis(M_A, nu_r) @ nu_r)
    np.testing.assert_allclose(tank.nu_dot(), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("time_step", [0.0, 1e-3])
def test_five_times_its_own_mass_in_added_mass_is_stable(X_WI, time_step):
    D, F, duration = 4.0, 9.0, 2.0
    parameters = one_body(
        added_mass=[AddedMass(5.0 * np.array([MASS] * 3 + list(INERTIA)))],
        drag=[Drag(linear=np.array([D, D, D, 0.2, 0.2, 0.2]))])
    tank = Tank(parameters, X_WI=X_WI, time_step=time_step, gravity=np.zeros(3))
    tank.set(np.zeros(6), TILTED)
    tank.fix_force(np.array([0.0, F, 0.0, 0.0, 0.0, 0.0]))
    if time_step == 0.0:
        tank.simulate(duration)
        decay = np.exp(-D * duration / (6.0 * MASS))
    else:
        Simulator(tank.diagram, tank.context).AdvanceTo(duration)
        decay = (1.0 - time_step * D / (6.0 * MASS)) ** round(duration / time_step)
    np.testing.assert_allclose(tank.nu(), [0.0, F / D * (1.0 - decay), 0, 0, 0, 0], atol=1e-8)


# A robot with joints -----------------------------------------------------------------------------


def test_the_inertia_is_symmetric_positive_definite_and_contains_all_added_mass(X_WI):
    """M⁻¹ is the response to unit forces; ½vᵀMv is the kinetic energy of robot and water."""
    parameters = robot_water()
    tank = Tank(parameters, robot(), X_WI)
    tank.set(**ROBOT_STATE)
    tank.fix("generalized_force", np.zeros(tank.nv))
    at_zero = tank.v_dot()
    columns = []
    for unit in np.eye(tank.nv):
        tank.fix("generalized_force", unit)
        columns.append(tank.v_dot() - at_zero)
    inverse = np.array(columns).T
    np.testing.assert_allclose(inverse, inverse.T, atol=1e-12)
    M = np.linalg.inv(inverse)
    assert np.linalg.eigvalsh(M)[0] > 0.0
    v = tank.plant.GetVelocities(tank.plant_context)
    # Drake counts a rotor's kinetic energy with the rest.
    np.testing.assert_allclose(0.5 * v @ M @ v, tank.kinetic_energy(parameters), rtol=1e-10)


def test_total_energy_is_conserved_in_ten_seconds_of_free_motion_without_drag(X_WI):
    parameters = robot_water(drag=False)
    tank = Tank(parameters, robot(), X_WI)
    tank.set(**ROBOT_STATE)

    def total():
        return tank.kinetic_energy(parameters) + tank.potential_energy(parameters)

    before, kinetic = total(), tank.kinetic_energy(parameters)
    tank.simulate(10.0, accuracy=1e-9)
    assert abs(tank.kinetic_energy(parameters) - kinetic) > 1.0  # The weight has done work.
    assert total() == pytest.approx(before, abs=1e-6 * kinetic)


def test_a_uniform_current_is_still_water_seen_by_a_moving_observer(X_WI):
    current_I, duration = np.array([0.4, -0.3, 0.2]), 2.0
    still = Tank(robot_water(), robot(damping=0.3), X_WI)
    still.set(**ROBOT_STATE)
    still.simulate(duration)

    moving = Tank(robot_water(), robot(damping=0.3), X_WI)
    current_B = TILTED.rotation().matrix().T @ current_I
    moving.set(**ROBOT_STATE | {"nu": ROBOT_STATE["nu"] + np.append(current_B, np.zeros(3))})
    moving.fix_current(current_I)
    moving.simulate(duration)

    drift = np.zeros(still.plant.num_multibody_states())
    drift[4:7] = X_WI.rotation() @ current_I * duration
    drift[9 + 3:9 + 6] = X_WI.rotation() @ current_I
    np.testing.assert_allclose(
        moving.plant.GetPositionsAndVelocities(moving.plant_context) - drift,
        still.plant.GetPositionsAndVelocities(still.plant_context), atol=1e-7)


@pytest.mark.parametrize(
    ("time_step", "solver"),
    [(0.0, None), *((0.004, each) for each in DiscreteContactApproximation.__members__.values())])
def test_the_plant_accelerates_exactly_as_solved(X_WI, time_step, solver):
    """With joint damping, rotors, current, force and disturbance; h times damping ≫ inertia."""
    tank = Tank(robot_water(), robot(damping=400.0), X_WI, time_step=time_step, solver=solver)
    tank.set(**ROBOT_STATE)
    tank.fix_current([0.3, 0.2, -0.1])
    tank.fix("generalized_force", np.linspace(-3.0, 5.0, tank.nv))
    tank.fix("acceleration_disturbance", np.linspace(0.4, -0.2, tank.nv))
    np.testing.assert_allclose(tank.v_dot(), tank.solved(), rtol=1e-9, atol=1e-9)


def test_a_robot_that_feels_no_water_moves_as_in_a_vacuum(X_WI):
    tank = Tank(HydrodynamicParameters(), robot(damping=0.3), X_WI)
    tank.set(**ROBOT_STATE)
    plant = tank.plant
    alone = plant.CreateDefaultContext()
    plant.SetPositionsAndVelocities(
        alone, plant.GetPositionsAndVelocities(tank.plant_context))
    expected = plant.EvalTimeDerivatives(alone).CopyToVector()[-tank.nv:]
    np.testing.assert_allclose(tank.v_dot(), expected, rtol=1e-12, atol=1e-12)


# The system --------------------------------------------------------------------------------------


def test_a_quaternion_that_is_off_by_rounding_does_no_harm():
    tank = Tank(robot_water(), robot())
    tank.set(**ROBOT_STATE)
    exact = tank.v_dot()
    q = tank.plant.GetPositions(tank.plant_context)
    q[:4] *= 1.0 + 1e-9
    tank.plant.SetPositions(tank.plant_context, q)
    np.testing.assert_allclose(tank.v_dot(), exact, rtol=1e-7)


SLANTED = Wave(amplitude=0.3, period=5.0, direction=0.7, phase=0.4, depth=3.0)
DEEP = Wave(amplitude=0.25, period=6.0, depth=2.4)
POSE = RigidTransform(RollPitchYaw(0.4, -0.9, 2.1), np.array([0.3, 0.2, 4.0]))


# Waves -------------------------------------------------------------------------------------------


def potential(wave, x, z, time):
    """Returns the velocity potential at x along the wave and the depth z (Newman, ch. 6)."""
    k = wave.wavenumber
    phase = wave.frequency * time + wave.phase - k * x
    return -wave.amplitude * G / wave.frequency * np.exp(-k * z) * np.sin(phase)


def test_the_water_moves_by_the_gradient_of_the_velocity_potential():
    d, z = 1e-5, SLANTED.depth
    e = np.array([np.cos(0.7), np.sin(0.7), 0.0])
    for time in (0.0, 0.9, 2.3, 4.1):
        along = (potential(SLANTED, d, z, time) - potential(SLANTED, -d, z, time)) / (2.0 * d)
        down = (potential(SLANTED, 0.0, z + d, time)
                - potential(SLANTED, 0.0, z - d, time)) / (2.0 * d)
        velocity, _ = SLANTED.motion(time)
        np.testing.assert_allclose(velocity, along * e + np.array([0.0, 0.0, down]), atol=1e-8)


def test_the_acceleration_is_the_rate_of_the_velocity():
    for time in (0.0, 0.9, 2.3, 4.1):
        ahead, behind = (SLANTED.motion(time + d)[0] for d in (1e-5, -1e-5))
        np.testing.assert_allclose(SLANTED.motion(time)[1], (ahead - behind) / 2e-5, atol=1e-9)


def test_no_water_is_faster_than_the_bound():
    waves = [SLANTED, DEEP, replace(DEEP, period=3.1, direction=-2.0, amplitude=0.1)]
    motions = [water_motion(np.zeros(3), waves, t) for t in np.linspace(0.0, 400.0, 4000)]
    fastest = np.max(np.linalg.norm(motions, axis=2), axis=0)[0]
    assert 0.75 * largest_speed(waves) < fastest <= largest_speed(waves)


# Bodies in them ----------------------------------------------------------------------------------


def inertia(size):
    return size, 1.2 * size, 1.5 * size


ARM = (link("vehicle", 7.0, (0.03, -0.02, 0.06), inertia=inertia(0.3))
       + link("lower", 1.3, (0.17, -0.03, 0.02), "vehicle", "0.4 0.1 0.2 0.1 0.3 -0.5",
              inertia(0.02)) + joint("elbow", "vehicle", "lower", "0 0.6 0.8", 0.0))


def body(mass, com, seed, drag=2.0, buoyant=1.0, rise=0.0):
    return BodyHydrodynamics(
        displaced_volume=buoyant * mass / DENSITY,
        center_of_buoyancy=np.asarray(com) + [0.0, 0.0, -rise],
        added_mass=[AddedMass(0.3 * mass * random_added_mass(seed), np.array([0.1, -0.2, 0.05]))],
        drag=[Drag(np.full(6, drag), np.full(6, drag), np.array([-0.1, 0.05, 0.1]))])


def arm_water(**kwargs):
    return HydrodynamicParameters(DENSITY, {
        "vehicle": body(7.0, (0.03, -0.02, 0.06), 1, **kwargs),
        "lower": body(1.3, (0.17, -0.03, 0.02), 2, **kwargs)})


def in_body(v_W, omega_W=(0.0, 0.0, 0.0)):
    """Returns ν (6,) of velocities in World, at `POSE`."""
    return (np.array([v_W, omega_W]) @ POSE.rotation().matrix()).ravel()


WAVES = [SLANTED, replace(DEEP, period=3.1, direction=-2.0, amplitude=0.1)]
CURRENT = np.array([0.1, -0.2, 0.05])


def test_a_neutral_arm_moves_with_the_water_and_does_not_bend():
    tank = Tank(arm_water(), ARM, waves=WAVES, current=CURRENT)
    tank.set(in_body(water_motion(CURRENT, WAVES, 0.0)[0]), POSE, q=[0.4], q_dot=[0.0])
    times, v = tank.simulate(2.0, 1e-11)
    np.testing.assert_allclose(v[:, [0, 1, 2, 6]], 0.0, atol=1e-8)
    np.testing.assert_allclose(
        v[:, 3:6], [water_motion(CURRENT, WAVES, t)[0] for t in times], atol=1e-8)


def test_a_heavy_sphere_follows_the_water_in_part():
    """(m + ½ρV) v̇ = 1.5 ρV v̇_c + (m − ρV) g, whose integral is known."""
    mass, volume = 5.0, 0.004
    tank = Tank(sphere(volume), link("vehicle", mass), waves=WAVES)
    tank.set(np.zeros(6), POSE)
    times, v = tank.simulate(3.0, 1e-11)
    water = np.array([water_motion(np.zeros(3), WAVES, t)[0] for t in times])
    total = mass + 0.5 * DENSITY * volume
    expected = 1.5 * DENSITY * volume / total * (water - water[0])
    expected[:, 2] += (mass - DENSITY * volume) * G / total * times
    np.testing.assert_allclose(v[:, 3:], expected, atol=1e-9)


def test_accelerating_water_is_still_water_in_a_frame_that_accelerates():
    """There gravity is g − v̇_c, for weight and for buoyancy; any robot, any motion."""
    rng = np.random.default_rng(5)
    parameters = arm_water(buoyant=0.8, rise=0.1)
    for _ in range(4):
        current, rate = rng.normal(size=(2, 3))
        omega, v, q, q_dot = rng.normal(size=3), rng.normal(size=3), rng.normal(), rng.normal()
        moving = Tank(parameters, ARM)
        moving.fix("current", current)
        moving.fix("current_acceleration", rate)
        moving.set(in_body(v, omega), POSE, [q], [q_dot])
        still = Tank(parameters, ARM, gravity=np.array([0.0, 0.0, G]) - rate)
        still.set(in_body(v - current, omega), POSE, [q], [q_dot])
        expected = still.v_dot()
        expected[3:6] += rate
        np.testing.assert_allclose(moving.v_dot(), expected, rtol=1e-10, atol=1e-10)


def test_what_holds_a_body_in_a_wave_is_morisons_force():
    """ρV(1 + C_A) v̇_c + drag, C_A = ½ of a sphere."""
    volume, drag = 0.004, 30.0
    strip = Drag(np.full(6, drag), np.full(6, drag))
    tank = Tank(sphere(volume, drag=[strip]), link("vehicle", DENSITY * volume), waves=WAVES)
    tank.set(np.zeros(6))
    for time in (0.3, 1.7, 4.4):
        tank.context.SetTime(time)
        v, a = water_motion(np.zeros(3), WAVES, time)
        force = 1.5 * DENSITY * volume * a + drag * (1.0 + np.abs(v)) * v
        tank.fix("generalized_force", np.concatenate([np.zeros(3), -force]))
        np.testing.assert_allclose(tank.v_dot(), 0.0, atol=1e-12)
