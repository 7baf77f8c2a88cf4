"""Waves against the velocity potential, and bodies in water that accelerates, by closed forms."""

from dataclasses import replace

import numpy as np
from pydrake.math import RigidTransform, RollPitchYaw
from support.tank import G, Tank, joint, link, random_added_mass

from uvms_drake.model.description.hydrodynamics_file import (
    AddedMass,
    BodyHydrodynamics,
    Drag,
    HydrodynamicParameters,
)
from uvms_drake.plant.waves import Wave, largest_speed, water_motion

RHO = 1000.0  # kg/m³
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
        displaced_volume=buoyant * mass / RHO,
        center_of_buoyancy=np.asarray(com) + [0.0, 0.0, -rise],
        added_mass=[AddedMass(0.3 * mass * random_added_mass(seed), np.array([0.1, -0.2, 0.05]))],
        drag=[Drag(np.full(6, drag), np.full(6, drag), np.array([-0.1, 0.05, 0.1]))])


def arm_water(**kwargs):
    return HydrodynamicParameters(RHO, {
        "vehicle": body(7.0, (0.03, -0.02, 0.06), 1, **kwargs),
        "lower": body(1.3, (0.17, -0.03, 0.02), 2, **kwargs)})


def in_body(v_W, omega_W=(0.0, 0.0, 0.0)):
    """Returns ν (6,) of velocities in World, at `POSE`."""
    return (np.array([v_W, omega_W]) @ POSE.rotation().matrix()).ravel()


def sphere(volume, drag=0.0):
    half = 0.5 * RHO * volume
    return HydrodynamicParameters(RHO, {"vehicle": BodyHydrodynamics(
        displaced_volume=volume, added_mass=[AddedMass(np.array([half] * 3 + [0.0] * 3))],
        drag=[Drag(np.full(6, drag), np.full(6, drag))])})


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
    total = mass + 0.5 * RHO * volume
    expected = 1.5 * RHO * volume / total * (water - water[0])
    expected[:, 2] += (mass - RHO * volume) * G / total * times
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
    mass, volume, drag = 4.0, 0.004, 30.0
    tank = Tank(sphere(volume, drag), link("vehicle", mass), waves=WAVES)
    tank.set(np.zeros(6))
    for time in (0.3, 1.7, 4.4):
        tank.context.SetTime(time)
        v, a = water_motion(np.zeros(3), WAVES, time)
        force = 1.5 * RHO * volume * a + drag * (1.0 + np.abs(v)) * v
        tank.fix("generalized_force", np.concatenate([np.zeros(3), -force]))
        np.testing.assert_allclose(tank.v_dot(), 0.0, atol=1e-12)
