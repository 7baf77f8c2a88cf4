"""Tests of `uvms_drake.campaign.variation`: draws are inside the bounds."""

from dataclasses import replace

import numpy as np
import pytest
from uvms_drake.campaign.certified_surfaces import moved

from uvms_drake.campaign.campaign import Target, make_campaign
from uvms_drake.campaign.variation import POSE_REACH, SHIFT_REACH, vary
from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.mpc.solver_faults import DroppedPeriod, SolverFailure, SolverTimeout
from uvms_drake.plant.adversary import AdversarialDisturbance
from uvms_drake.station.problem import make_ocp, start_state
from uvms_drake.station.scenario.scenario import dump_scenario, load_scenario

pytestmark = pytest.mark.long


def test_what_is_drawn_is_a_function_of_seed_and_index(campaign):
    def text(campaign, index):
        return dump_scenario(vary(campaign, index).scenario)

    assert text(campaign, 4) == text(campaign, 4)
    assert text(campaign, 4) != text(campaign, 5)
    assert text(campaign, 4) != text(replace(campaign, seed=4), 4)


def test_what_is_drawn_is_inside_the_bounds_and_comes_in_all_kinds(campaign):
    base = campaign.base
    kinds, faults = set(), set()
    for index in range(16):
        scenario, outside = vary(campaign, index)
        start_state(scenario, make_ocp(scenario))  # raises outside of the nominal limits
        yaw = np.arctan2(*-scenario.surface.normal[1::-1])
        start = moved(base, yaw, scenario.surface.point).start
        assert np.all(np.abs(scenario.start.eta - start.eta) <= POSE_REACH)
        assert np.all(np.abs(scenario.surface.point) <= SHIFT_REACH)
        assert scenario.disturbance.bound == base.disturbance.bound
        assert outside is None
        kinds.add(getattr(scenario.disturbance, "kind", type(scenario.disturbance).__name__))
        faults |= {type(fault) for fault in scenario.faults}
    assert len(kinds) > 6
    assert faults <= {SolverFailure, SolverTimeout, DroppedPeriod}
    assert len(faults) > 1


def test_what_is_drawn_has_the_weights_of_the_base():
    weights = [0.1, 0.1, 0.1, 0.2, 0.2, 0.2, 1.0, 1.0, 1.0, 1.0]
    campaign = make_campaign(load_scenario("girona500_ideal", [
        "duration=0.6", f"disturbance.weights={weights}"]), 3, None)
    for index in range(3):
        disturbance = vary(campaign, index).scenario.disturbance
        np.testing.assert_array_equal(disturbance.weights, weights)
        assert disturbance.bound == campaign.base.disturbance.bound


def test_a_scenario_with_an_adversary_goes_through_a_file(campaign, tmp_path):
    drawn = (vary(campaign, index).scenario for index in range(20))
    aimed = next(scenario for scenario in drawn
                 if isinstance(scenario.disturbance, AdversarialDisturbance))
    file = tmp_path / "aimed.yaml"
    file.write_text(dump_scenario(aimed), encoding="utf-8")
    assert dump_scenario(load_scenario(str(file))) == dump_scenario(aimed)


def test_another_desired_force_has_the_terminal_set_of_its_own(campaign):
    other = replace(campaign, targets=(Target(None, 0.8, 0.3),))
    scenario = vary(other, 0).scenario
    assert np.linalg.norm(scenario.task.force) == pytest.approx(
        0.8 * np.linalg.norm(campaign.base.task.force))
    assert scenario.mpc.terminal_radius == 0.3


def test_a_base_that_cannot_be_used_says_so(campaign):
    text = campaign.scenario.replace("force: [20.0", "force: [900.0")
    with pytest.raises(InvalidParameter, match=r"task\.force.*limits\.static_force"):
        vary(replace(campaign, scenario=text), 0)
