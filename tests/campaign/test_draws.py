"""Tests of `campaign.draws`: draws are inside of the declared bounds, and told with them."""

from dataclasses import replace

import numpy as np
import pytest

import uvms_drake as uv
from uvms_drake.campaign.campaign import make_campaign
from uvms_drake.campaign.draws import POSE_REACH, declared_distribution, drawn_unknowns, vary
from uvms_drake.control.mpc.solver_faults import DroppedPeriod, SolverFailure, SolverTimeout
from uvms_drake.plant.adversary import AdversarialDisturbance
from uvms_drake.plant.model_error import LEAST_FACTOR
from uvms_drake.plant.waves import Wave
from uvms_drake.station.scenario.scenario import dump_scenario

pytestmark = pytest.mark.slow

REAL = "girona500_real_loop"


@pytest.fixture(scope="module")
def drawn(campaign):
    return [vary(campaign, index) for index in range(12)]


def test_a_run_is_a_function_of_seed_and_index(campaign, drawn):
    def text(campaign, index):
        return dump_scenario(vary(campaign, index))

    assert text(campaign, 4) == dump_scenario(drawn[4]) != dump_scenario(drawn[5])
    assert dump_scenario(drawn[4]) != text(replace(campaign, seed=4), 4)


def test_draws_are_inside_of_the_bounds_and_come_in_all_kinds(campaign, drawn):
    base = campaign.base
    for scenario in drawn:
        uv.start_state(scenario, uv.make_ocp(scenario))  # It raises outside of the nominal limits.
        assert np.all(np.abs(scenario.start.eta - base.start.eta) <= POSE_REACH)
        assert scenario.disturbance.bound == base.disturbance.bound
        np.testing.assert_array_equal(scenario.disturbance.weights, base.disturbance.weights)
    assert len({scenario.disturbance.label for scenario in drawn}) > 5
    assert len({type(scenario.surface.geometry) for scenario in drawn}) > 1
    faults = {type(fault) for scenario in drawn for fault in scenario.faults}
    assert len(faults) > 1 and faults <= {SolverFailure, SolverTimeout, DroppedPeriod}


def test_a_drawn_scenario_goes_through_a_file(drawn, tmp_path):
    aimed = next(scenario for scenario in drawn
                 if isinstance(scenario.disturbance, AdversarialDisturbance))
    file = tmp_path / "aimed.yaml"
    file.write_text(dump_scenario(aimed), encoding="utf-8")
    assert dump_scenario(uv.load_scenario(str(file))) == dump_scenario(aimed)


def test_a_base_that_cannot_be_used_says_so(campaign):
    text = campaign.scenario.replace("force: [20.0", "force: [900.0")
    with pytest.raises(uv.InvalidParameter, match=r"task\.force"):
        vary(replace(campaign, scenario=text), 0)


def test_unknowns_are_drawn_up_to_their_size_where_they_are_declared():
    """Errors of either sign and currents of any direction; exact values stay exact."""
    scenario = uv.load_scenario(REAL, ["model_error.payload.mass=0.2"])
    drawn = [drawn_unknowns(scenario.unknowns, np.random.default_rng(seed)) for seed in range(200)]
    corners = [drawn_unknowns(scenario.unknowns, np.random.default_rng(seed), 1.0)
               for seed in range(40)]
    assert all(np.hypot(*each.current[:2]) == pytest.approx(0.1)
               and each.error.payload.mass == 0.2 for each in corners)
    assert {round(each.error.mass, 9) for each in corners} == {0.9, 1.1}
    masses = np.array([each.error.mass for each in drawn])
    assert np.all(np.abs(masses - 1.0) <= 0.1 + 1e-12)
    assert np.min(masses) < 0.92 and np.max(masses) > 1.08
    speeds = np.linalg.norm([each.current for each in drawn], axis=1)
    assert np.all(speeds <= 0.1 + 1e-12) and 0.2 < np.mean(speeds > 0.1 - 1e-9) < 0.35
    assert np.all(np.abs(np.mean([each.current for each in drawn], axis=0)) < 0.02)
    payloads = [each.error.payload.mass for each in drawn]
    assert 0.0 <= min(payloads) < 0.02 < 0.18 < max(payloads) <= 0.2
    assert all(each.error.drag == each.error.added_mass == 1.0 for each in drawn)
    # Waves and friction are drawn after the others, which they leave as they are.
    wavy = uv.load_scenario(REAL, [
        "model_error.payload.mass=0.2", "waves=[{amplitude: 0.1, period: 6.0}]",
        "model_error.joint_friction.static=[0.5]"])
    more = [drawn_unknowns(wavy.unknowns, np.random.default_rng(seed)) for seed in range(20)]
    assert [each.error.mass for each in more] == masses[:20].tolist()
    assert len({each.waves[0].phase for each in more}) == 20
    for sizes, largest in (([each.waves[0].amplitude for each in more], 0.1),
                           ([each.error.joint_friction.largest for each in more], 0.5)):
        assert min(sizes) < 0.5 * largest and max(sizes) == pytest.approx(largest)
    assert isinstance(more[0].waves[0], Wave) and drawn[0].waves == []


def test_errors_by_axis_are_drawn_one_by_one_and_leave_every_other_draw_as_it_is():
    plain, by_axis = (uv.load_scenario(REAL, more).unknowns for more in ([], [
        "model_error.vehicle.added_mass=[1.2, 1, 1, 1.5, 1, 1]",
        "model_error.arm.linear_drag=[1.3]", "model_error.buoyancy_shift=[0.01, 0.02, 0]"]))
    drawn = [[drawn_unknowns(each, np.random.default_rng(seed)) for seed in range(100)]
             for each in (plain, by_axis)]
    assert all(one.error.mass == other.error.mass and np.array_equal(one.current, other.current)
               for one, other in zip(*drawn, strict=True))
    factors = np.array([each.error.vehicle.added_mass for each in drawn[1]]) - 1.0
    assert np.all(np.abs(factors) <= [0.2 + 1e-12, 0, 0, 0.5 + 1e-12, 0, 0])
    assert abs(np.corrcoef(factors[:, 0], factors[:, 3])[0, 1]) < 0.3
    corners = [drawn_unknowns(by_axis, np.random.default_rng(seed), 1.0).error for seed in range(9)]
    assert all(np.allclose(np.abs(each.arm.linear_drag - 1.0), 0.3) for each in corners)
    shifts = np.array([each.buoyancy_shift for each in corners])
    np.testing.assert_allclose(np.abs(shifts), np.tile([0.01, 0.02, 0.0], (9, 1)))
    assert len({tuple(each) for each in np.sign(shifts)}) > 2
    assert drawn[0][0].error.vehicle is None


def test_a_factor_above_two_is_drawn_down_to_the_least_that_a_robot_can_have():
    wide = uv.load_scenario(REAL, [
        "model_error.drag=3.0", "model_error.vehicle.quadratic_drag=[1, 3, 1, 1, 1, 1]"]).unknowns
    drawn = [drawn_unknowns(wide, np.random.default_rng(seed)).error for seed in range(60)]
    for found in ([each.drag for each in drawn],
                  [each.vehicle.quadratic_drag[1] for each in drawn]):
        assert min(found) == LEAST_FACTOR < 1.0 < 2.5 < max(found) <= 3.0


def test_errors_of_thrusters_are_drawn_one_by_one_and_leave_every_other_draw_as_it_is():
    plain, wrong = ([vary(make_campaign(uv.load_scenario(REAL, [
        "supervisor=null", *more]), 1, None), index)  # Its thresholds count them.
        for index in range(2)] for more in ([], ["actuation.1.error=[0.1]"]))
    errors = np.array([scenario.actuation[1].error for scenario in wrong])
    assert errors.shape == (2, 5) and len(np.unique(np.abs(errors))) > 3
    assert 0.05 < np.max(np.abs(errors)) <= 0.1
    for one, other in zip(plain, wrong, strict=True):
        other.actuation[1].error = np.zeros(1)
        assert dump_scenario(other) == dump_scenario(one)


@pytest.mark.parametrize(("scenario", "overrides", "parts"), [
    (REAL, [], ("mass 0.1", "current 0.1 m/s from any heading",
                "uniform from 5 to 20 N, held for 20 to 20 s",
                "within (0.25, 0.14, 0.16, 0.35) rad",
                "with the probability 0.2 all unknowns",
                "friction up to 0.5", "stiffness from 0.1 of 1000 N/m")),
    (REAL, ["waves=[{amplitude: 0.1}]", "model_error.joint_friction.coulomb=[0.5]",
            "model_error.payload.mass=0.5", "disturbance.bound=0.02", "actuation.1.error=[0.1]"],
     ("waves 0.0", "joint friction 0.5 N m", "payload 0.5 kg", "full bound 0.02",
      "force of each thruster off by 0.1 of it; each of either sign")),
    ("jacket_inspection_real", [],
     ("mission, the same in every run: approach ", "at (-0.2, 0.06) m",
      "slide force 10 N, along (0.5, 0) m, speed 0.02 m/s", "wherever the mission may"))])
def test_the_distribution_is_told_with_the_scenarios_own_sizes(scenario, overrides, parts):
    text = "\n".join(declared_distribution(uv.load_scenario(scenario, overrides)))
    for part in parts:
        assert part in text, part
    assert ("waves" in text) == bool(overrides)
    assert ("desired force: uniform" in text) == (scenario == REAL)
