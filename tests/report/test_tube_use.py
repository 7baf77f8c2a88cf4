"""The use of a tube: each row by numbers that do not come from it."""

from dataclasses import replace

import numpy as np
import pytest
from support.missions import mission_record
from support.synthetic import synthetic_record, synthetic_sensed_record

from uvms_drake.campaign.run import off_line
from uvms_drake.control.limits.inputs import input_names
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.report.tube_use import deviations, off_knots, tube_use


def test_each_row_is_the_largest_deviation_over_its_radius():
    """The state is off by 1.5 mm sin t, weights 1 to 0.2, the velocity by five times that."""
    record = synthetic_record(4.0)
    use, most = tube_use(record), 0.0015 * np.max(np.abs(np.sin(record.time)))
    part = np.linspace(1.0, 0.2, 10)
    assert use["roll"] == pytest.approx(most * part[3] / 0.002)
    assert use["pitch"] == pytest.approx(most * part[4] / 0.001)
    for name, rows, radius in (("nu1", slice(3), 0.03), ("nu2", slice(3, 6), 0.02),
                               ("qdot", slice(6, 10), 0.01)):
        assert use[name] == pytest.approx(5.0 * most * np.linalg.norm(part[rows]) / radius)
    assert use["u_surge"] == pytest.approx(20.0 * most / 0.1)
    assert use["u_q4"] == pytest.approx(20.0 * most * 0.2 / 0.3)
    assert use["position"] == pytest.approx(np.max(record.tube_deviation[:, 1]) / 0.005)
    # A wall that is known has no depth along a declared direction, and tau no radius here.
    assert not {name for name in use if name.startswith(("depth", "tau"))}


def test_speeds_of_the_tip_are_the_rate_of_its_pose():
    """By differences of the pose along the motion; τ̄ = M(𝔮̄)ū by differences of the momentum."""
    record = synthetic_sensed_record(2.0)
    found, model, step = deviations(record), record.model, 1e-6

    def speed(config, zeta):
        rate = step * configuration_rate(config, zeta)
        return (model.task_pose(config + rate) - model.task_pose(config - rate))[:, :3] / 2e-6

    off = speed(record.config, record.zeta) - speed(record.nominal_config, record.nominal_zeta)
    np.testing.assert_allclose(found["tip_speed"], np.linalg.norm(off, axis=1), atol=1e-7)
    np.testing.assert_allclose(found["depth_speed"], np.abs(off[:, 0]), atol=1e-7)
    np.testing.assert_allclose(
        found["depth"], np.abs(record.chi[:, 0] - record.chi_nominal[:, 0]), atol=1e-12)
    i, at = 50, record.nominal_config[50]
    unforced, forced = (model.inverse_dynamics(
        model.kinematics(at), np.zeros(10), zeta_dot, np.zeros(6))
        for zeta_dot in (np.zeros(10), record.nominal_input[i]))
    each = [found[f"tau_{name}"][i] for name in input_names(4)]
    np.testing.assert_allclose(each, np.abs(record.tau[i] - (forced - unforced)), atol=1e-8)


def test_between_knots_a_plan_of_constant_jerk_is_off_by_the_closed_form():
    """(2/81) h³j at two thirds of an interval, where a sample is; none is at a step of 70 ms."""
    time, step, jerk = np.linspace(0.0, 1.5, 76), 0.3, 1.7
    found = off_knots(time, jerk * time**3 / 6.0, jerk * time**2 / 2.0, step)
    assert np.max(found[:15]) == pytest.approx(2.0 / 81.0 * step**3 * jerk, rel=1e-6)
    np.testing.assert_allclose(found[::15], 0.0, atol=1e-15)
    np.testing.assert_allclose(found[:15], found[45:60], atol=1e-14)
    assert not np.any(off_knots(time, time**3, 3.0 * time**2, 0.07))


def test_a_deviation_counts_from_the_end_of_the_hover_on():
    record = synthetic_record(4.0)
    state = record.state.copy()
    state[record.time < 1.0, 3] += 0.1
    early = replace(record, state=state)
    assert tube_use(early)["roll"] > 50.0
    hovering = replace(early.scenario, mpc=replace(early.scenario.mpc, hover=1.0))
    assert tube_use(replace(early, scenario=hovering)) == pytest.approx(tube_use(record))
    longer = replace(early.scenario, mpc=replace(early.scenario.mpc, hover=5.0))
    assert tube_use(replace(early, scenario=longer)) == {}


def held(error, line=None):
    """The force of 20 N until the end, off by so much, and zero before the touch."""
    record = synthetic_sensed_record(8.0)
    force = record.force.copy()
    force[:, 0] = np.where(record.time < 1.0, 0.0, 20.0 + error(record.time))
    contact = replace(record.scenario.contact, force_line=line)
    return replace(record, force=force, scenario=replace(record.scenario, contact=contact))


def test_a_force_that_never_settles_is_off_its_line():
    """A tenth of 20 N; it is no matter whether it was ever within."""
    assert off_line(held(lambda t: 2.4 + 0.0 * t)) == pytest.approx(1.2)
    assert off_line(held(lambda t: 3.0 * np.sin(2.0 * np.pi * t))) == pytest.approx(1.5, rel=3e-3)
    assert off_line(held(lambda t: np.where(t < 5.9, 9.0, 0.5))) == pytest.approx(0.25)
    assert off_line(held(lambda t: np.where(t < 6.1, 9.0, 0.5))) == pytest.approx(4.5)
    assert off_line(held(lambda t: 2.4 + 0.0 * t, line=4.8)) == pytest.approx(0.5)
    assert off_line(synthetic_record(4.0)) is None


def test_a_small_force_is_held_no_better_than_its_sensor_reads():
    record = held(lambda t: -12.0 + 0.0 * t)
    desired = np.where(record.time < 1.0, 0.0, 8.0)[:, None] * np.eye(6)[0]
    found = off_line(replace(record, force=desired + np.eye(6)[0], desired_force=desired))
    assert 0.5 < found < 0.7  # 1 N over the 1.6 N of the sensor, more than a tenth of 8 N.


def test_each_hold_of_a_mission_counts_and_no_slide():
    """The force is off by a sine of 1.5 N in all steps, of which the second is a hold."""
    record = mission_record()
    assert off_line(record) == pytest.approx(1.5 / 1.622, rel=0.05)
    for begin, end, off in ((2.05, 4.0, 1.0), (1.5, 1.9, 34.0)):  # In the slide, and in the hold.
        other = record.force.copy()
        other[(record.time >= begin) & (record.time < end), 0] += 50.0
        assert off_line(replace(record, force=other)) == pytest.approx(
            off * off_line(record), rel=0.2)
