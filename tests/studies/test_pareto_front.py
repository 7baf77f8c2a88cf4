"""Tests of `uvms_drake.studies.pareto_front`."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from support.quick import FEW

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.laws import Resolved, TipFirst
from uvms_drake.papers.nikou2018 import Transpose
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.studies.pareto_front import format_pareto_front, pareto_front

pytestmark = pytest.mark.usefixtures("few_searches")

@pytest.mark.long
def test_larger_gains_certify_a_smaller_force_error(model):
    points = pareto_front(load_scenario("girona500_ideal", FEW), model, disturbances=(1.0,),
                   gains=(0.5, 1.0))
    assert points[1].force < points[0].force
    assert points[0].emptied
    assert not points[1].emptied
    assert format_pareto_front(points).count("not certified") == 1


def test_where_a_law_has_no_tube_the_front_says_why(model):
    """The paper's law feeds back χ, which does not determine the joints of an arm."""
    scenario = replace(load_scenario("girona500_ideal", FEW),
                       ancillary=Transpose(k=40.0, sigma=5.0))
    (point,) = pareto_front(scenario, model, disturbances=(1.0,), gains=(1.0,))
    assert point.force == np.inf
    assert point.emptied
    assert f"not certified: {point.emptied}" in format_pareto_front([point])


def test_a_law_without_a_certificate_has_no_front(model):
    @dataclass
    class Derived(Resolved):
        """Another law than the one it is derived from."""

    scenario = replace(load_scenario("girona500_ideal", FEW), ancillary=Derived())
    with pytest.raises(InvalidParameter, match="ancillary = 'Derived': must be a law with a cert"):
        pareto_front(scenario, model)


def test_a_law_with_gains_by_the_row_has_no_front(model):
    scenario = replace(load_scenario("girona500_ideal", FEW), ancillary=TipFirst())
    with pytest.raises(InvalidParameter, match="must be a law with one k and one σ, for a front"):
        pareto_front(scenario, model)
