"""A payload that a wrist sensor feels: against closed forms, the plant, and a known tool."""

import shutil

import numpy as np
import pytest
from support.robots import FIELD_CASES

import uvms_drake as uv
from uvms_drake.command.main import main
from uvms_drake.model.frames.euler import rotation_matrix
from uvms_drake.model.signals.sensor_actuator import PAYLOAD, PAYLOAD_AT_REST
from uvms_drake.plant.model_error import ModelError
from uvms_drake.plant.payload import Payload, holding_wrench

G = np.array([0.0, 0.0, 9.81])
BALL = Payload(mass=1.5, displaced=0.5, centre=np.array([0.02, -0.03, 0.1]))
ROBOT = "girona500_arm5e"


def plant_with(payload):
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
        found = holding_wrench(BALL, 1000.0, np.zeros(6), np.zeros(3), g, np.zeros(3))
        np.testing.assert_allclose(found[:3], -1.0 * g, atol=1e-12)
        np.testing.assert_allclose(found[3:], np.cross(BALL.centre, -1.0 * g), atol=1e-12)


@pytest.mark.parametrize("mass", [1.5, 0.3])
def test_no_motion_within_its_bounds_takes_more_than_the_largest_wrench(mass):
    """Accelerations and water at random, many at their bounds, all along gravity in one case."""
    ball = Payload(mass=mass, displaced=0.5, centre=BALL.centre, acceleration=3.0)
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
    held, free = plant_with(BALL), plant_with(None)
    contexts = [each.CreateDefaultContext() for each in (held, free)]
    rng = np.random.default_rng(2)
    model = uv.UvmsModel(uv.read_uvms(ROBOT))
    for state in states(6):
        tau, water = rng.normal(size=10) * 30.0, rng.normal(size=3)
        for plant, context in zip((held, free), contexts, strict=True):
            uv.set_state(plant, context, state)
            plant.GetInputPort("tau").FixValue(context, tau)
            plant.GetInputPort("disturbance").FixValue(context, np.zeros(10))
            plant.GetInputPort("current_acceleration").FixValue(context, water)
        zeta_dot = held.GetOutputPort("acceleration").Eval(contexts[0])
        wrench = held.GetOutputPort(PAYLOAD).Eval(contexts[0])
        at = model.kinematics(state[:10])
        reaction = -np.linalg.solve(at.A_E, at.J_chi).T @ wrench
        free.GetInputPort("tau").FixValue(contexts[1], tau + reaction)
        np.testing.assert_allclose(free.GetOutputPort("acceleration").Eval(contexts[1]), zeta_dot,
                                   rtol=1e-8, atol=1e-8)
        rest = held.GetOutputPort(PAYLOAD_AT_REST).Eval(contexts[0])
        R_WE = rotation_matrix(state[3:6]) @ at.R_BL[-1]
        np.testing.assert_allclose(rest[:3], R_WE.T @ (-1.0 * G), atol=1e-9)


# The sensor --------------------------------------------------------------------------------------

SENSOR = """
sensing:
  - !ForceSensor
    noise: [0, 0, 0, 0, 0, 0]
    resolution: [0, 0, 0, 0, 0, 0]
    bias: [0, 0, 0, 0, 0, 0]
    drift: [0, 0, 0, 0, 0, 0]
    lag: {lag}
    tare: {tare}
    mounting: [0.02, -0.03, -0.11, 0.4, -0.7, 2.1]
    tool: {tool}
model_error:
  payload: {payload}
"""


def recorded(folder, *, payload="{}", tool="{}", lag=0.0, tare=0.0, overrides=()):
    """Returns the record of a short run; the sensor is mounted aslant."""
    folder.mkdir()
    file = folder / "felt.yaml"
    file.write_text("base: girona500_ideal\nduration: 0.4" + SENSOR.format(
        payload=payload, tool=tool, lag=lag, tare=tare), encoding="utf-8")
    return uv.simulate(uv.load_scenario(str(file), list(overrides)))


def test_the_field_case_reads_what_hangs_at_the_tip(tmp_path):
    """(0, 0, −9.81) N of weight, 1 kg less its water, and 1.75 kg times the tip's acceleration.

    The acceleration is by second differences of the tip's logged positions.
    """
    file = tmp_path / "felt.yaml"
    shutil.copy(FIELD_CASES / "payload_not_felt" / "felt.yaml", file)
    assert main(["run", str(file), "--uncertified", "--no-figures", "--no-replay", "--quiet",
                 "--output", str(tmp_path / "out")]) in (0, 1)
    with np.load(tmp_path / "out" / "log.npz") as log:
        reading, tip, step = log["force_measured"][:, :3], log["chi"][:, :3], log["time"][1]
        rest, rpy = log[PAYLOAD_AT_REST][5], log["chi"][5, 3:]
    np.testing.assert_allclose(rotation_matrix(rpy) @ rest[:3], [0.0, 0.0, -9.81], atol=1e-9)
    accelerations = (tip[6] - 2.0 * tip[5] + tip[4]) / step**2
    assert np.linalg.norm(accelerations) > 0.3  # It is felt.
    np.testing.assert_allclose(
        reading[5], np.array([0.0, 0.0, -9.81]) + 1.75 * accelerations, atol=0.05)


def test_it_reads_the_weight_and_the_inertia_in_its_own_axes(tmp_path):
    """Every sample is the wrench at its instant, moved to the sensor by hand."""
    record = recorded(tmp_path / "run", payload="{mass: 1.5, displaced: 0.5, centre: [0, 0, 0.1]}")
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
def test_a_tare_takes_off_the_weight_but_not_its_turning(lag, tmp_path):
    """What is left after the tare is small; without it, all of the weight is read."""
    tared = recorded(tmp_path / "tared", payload="{mass: 1.5, displaced: 0.5}", lag=lag, tare=0.2)
    whole = recorded(tmp_path / "whole", payload="{mass: 1.5, displaced: 0.5}", lag=lag)
    late = tared.time > 0.25
    left, read = (np.linalg.norm(each.signals["force_raw"][late, :3], axis=1)
                  for each in (tared, whole))
    assert np.max(left) < 3.0
    assert np.min(read) > 7.0
