"""Runs that go on from a hold: repeatable, of the class, and with the error of their readings."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.unknown_wall import close_to_the_wall

import uvms_drake as uv
from uvms_drake.campaign.drawn_contact import tips
from uvms_drake.campaign.draws import first_feasible
from uvms_drake.control.limits.radii import HoldRadii
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.contact.drawn_surfaces import is_member

RESULTS = Path(__file__).parents[2] / "examples" / "results"
HOLD = HoldRadii(time=0.4, depth=4.8e-4, position=6.8e-4, advance=0.0175, standing=0.002,
                 reading=2.23, age=0.03)
"""Radii about those of the certificate."""


@pytest.fixture(scope="module")
def modules():
    """The modules of the adversary."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(RESULTS)
        import adversaries
        import hold_station
        yield adversaries, hold_station
        for name in ("adversaries", "hold_station", "make_all", "random_attacks", "unknowns"):
            sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def held(modules):
    """A station with the sign of the reading's error, and its first hold."""
    adversaries, hold_station = modules
    scenario = close_to_the_wall("surface.geometry.point.0=0.01", "contact.clearance=0.02")
    scenario = replace(scenario, tube=replace(scenario.tube, hold=HOLD))
    wall = adversaries.on_wall(scenario, "stiffest", -1.0)
    loop = hold_station.HoldStation(wall, -1.0, 0.6)
    return loop, loop.first_hold()


def test_an_attack_is_of_the_declared_class(modules):
    adversaries, hold_station = modules
    rng = np.random.default_rng(0)
    loop = hold_station.HoldStation(
        adversaries.on_wall(close_to_the_wall(), "hardening", 1.0), 1.0, 1.0)
    adversary = object.__new__(adversaries.Adversary)
    vars(adversary).update(
        _loop=loop, _time=0.01 * np.arange(100), _planned=np.arange(100) % 20 == 18,
        _steepest=np.full(10, 0.1**0.5), _kernels=[np.sign(rng.normal(size=20))] * 2)
    for _ in range(50):
        plan = adversaries.Plan.drawn(rng, 10).varied(rng, 10)
        attack = adversary.attack(plan)
        assert np.all(np.abs(attack.noise) <= 1.0 + 1e-12)
        assert np.all(np.linalg.norm(attack.disturbance, axis=1) <= 1.0 + 1e-12)
        assert np.any(attack.disturbance)


def test_a_random_attack_is_of_the_declared_class(modules):
    """Walls are members where the tip may touch them; errors of the forces are at their bounds."""
    attacks, scenario = modules[0].random_attacks, uv.load_scenario("girona500_contact")
    ocp = first_feasible(scenario, uv.make_ocp(scenario))
    contact, ends = sensed_contact(scenario), tips(scenario, ocp)
    shapes = set()
    for seed in range(12):
        rng = np.random.default_rng(seed)
        wall = attacks.wall_near(scenario, ocp, rng)
        shapes.add(type(wall.geometry))
        assert is_member(wall, contact, *ends)
        assert contact.clearance <= -float(wall.geometry.depth(ends[0])) < 0.2
        sensor = attacks.errors_of(scenario.sensing[0], rng)
        error = np.array([sensor.script(index) for index in range(400)])
        assert np.all(np.abs(error) <= 1.0)
        np.testing.assert_array_equal(np.abs(error[:, :3]), 1.0)
        assert np.all(error[: sensor.tare_samples, :3] == error[0, :3])
    assert len(shapes) > 2


@pytest.mark.slow
def test_going_back_to_a_hold_is_going_on_from_it(modules):
    """Bit for bit, with the MPC's sample at its instant."""
    adversaries, hold_station = modules
    scenario = close_to_the_wall()
    loop = hold_station.HoldStation(adversaries.on_wall(scenario, "softer", 1.0), 1.0, 0.4)
    simulator = loop.simulator

    def end():
        simulator.AdvanceTo(0.8)
        logs = adversaries.uv.read_logs(loop.station, simulator.get_context())
        return simulator.get_context().get_continuous_state_vector().CopyToVector(), logs

    simulator.AdvanceTo(0.4)
    context = simulator.get_context().Clone()
    state, logs = end()
    loop._go_back(hold_station.Held(context, {}))
    again, new = end()
    np.testing.assert_array_equal(again, state)
    late = logs["time"] >= new["time"][0] - 1e-9
    np.testing.assert_array_equal(new["state"], logs["state"][late])
    np.testing.assert_array_equal(new["mpc_time"][-2:], logs["mpc_time"][-2:])


@pytest.mark.slow
def test_the_hold_has_the_largest_constant_error_of_a_reading(held):
    """That of noise and of a tare that was off by as much."""
    loop, hold = held
    sensor, force = loop.sensor, hold.logs["force"][-1, 0]
    error = hold.logs["force_measured"][-1, 0] - force
    most = 2.0 * sensor.noise_multiple * sensor.noise[0] + sensor.resolution[0]
    most += sensor.drift[0] * hold.context.get_time()
    assert -most - 1e-9 <= error < -0.9 * most


@pytest.mark.slow
def test_the_hold_has_the_force_that_the_sensor_reads_as_wanted(held):
    _, hold = held
    force = hold.logs["force"][-1, 0]
    error = hold.logs["force_measured"][-1, 0] - force
    assert force - 20.0 == pytest.approx(-error, abs=0.15)


@pytest.mark.slow
def test_a_run_goes_on_from_the_hold_and_can_be_repeated(modules, held):
    adversaries, _ = modules
    loop, hold = held
    adversary = adversaries.Adversary(loop, hold)
    attack = adversary.attack(adversaries.Plan(push="constant", others="opposite", grip=0.1))
    first, other, again = (loop.run(hold, each) for each in (
        attack, attack._replace(disturbance=0.0 * attack.disturbance), attack))
    np.testing.assert_array_equal(first.state, again.state)
    np.testing.assert_array_equal(first.force, again.force)
    assert not np.array_equal(first.force, other.force)
    # It begins with the hold, and has the disturbance from there on.
    begin = hold.context.get_time()
    before = first.time < begin - 1e-6
    late = hold.logs["time"] > begin - 2.0
    np.testing.assert_array_equal(first.state[before], hold.logs["state"][late][:np.sum(before)])
    assert first.time[-1] == pytest.approx(begin + loop.duration, abs=0.011)
    assert np.all(np.diff(first.time) > 0.0)
    declared, after = loop.scenario.disturbance, first.time > begin + 0.01
    assert np.max(declared.norm(first.disturbance)) <= declared.d_bound
    np.testing.assert_allclose(declared.norm(first.disturbance[after]), declared.d_bound)
    assert not np.any(first.mpc_status)
    # The error over the band is that of the sensor, and the run was of the class.
    outcome = adversaries.outcome_of(first, begin)
    assert outcome.departures == ()
    assert 0.2 < outcome.ratio < 1.0
    assert outcome.error == pytest.approx(1.6, abs=0.6)
