"""Tests of `uvms_drake.studies.propose_gains`."""

import numpy as np
import pytest
from support.quick import FEW

from uvms_drake.certificate.certify import basis_of, tightening_margins
from uvms_drake.common.errors import InvalidParameter, RunFailed
from uvms_drake.station.problem import limits_of
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.studies.propose_gains import propose_gains
from uvms_drake.tube.laws.resolved import resolved_law_tube
from uvms_drake.tube.ultimate_bounds import ultimate_bounds

pytestmark = pytest.mark.usefixtures("few_searches")

def test_the_proposal_keeps_the_bandwidth_and_leaves_something_of_every_limit(model):
    scenario = load_scenario("girona500_ideal", FEW)
    law, error = propose_gains(scenario, model, 15.0)
    assert max(law.k, law.sigma) <= 15.0
    scenario.ancillary = law
    tube = resolved_law_tube(law, basis_of(scenario, model)).radii
    assert all(item.holds for item in tightening_margins(
        tube, limits_of(scenario, model)))
    chi_des = scenario.surface.pose_for(np.asarray(scenario.task.force), scenario.task.pose)
    bounds = ultimate_bounds(
        tube, scenario.surface, chi_des, np.asarray(scenario.task.force))
    assert bounds["force"] == pytest.approx(error)


def test_more_bandwidth_never_certifies_a_larger_error(model):
    scenario = load_scenario("girona500_ideal", FEW)
    assert propose_gains(scenario, model, 30.0)[1] < propose_gains(scenario, model, 15.0)[1]


def test_a_disturbance_beyond_the_inputs_has_no_gains(model):
    with pytest.raises(RunFailed, match="what would help"):
        propose_gains(load_scenario("girona500_ideal", [*FEW, "disturbance.bound=5"]), model, 8.0)


def test_a_bandwidth_must_be_positive(model):
    with pytest.raises(InvalidParameter, match="bandwidth"):
        propose_gains(load_scenario("girona500_ideal", FEW), model, -1.0)
