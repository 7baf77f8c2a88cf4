"""Tests of `uvms_drake.station.scenario.cost_check`."""

import pytest

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.station.scenario.scenario import check_cost, load_scenario
from uvms_drake.station.scenario.scenario_file import shipped_scenarios

USUAL = {"duration": 20.0, "log_period": 0.02, "max_step_size": 0.02, "time_step": 0.2,
         "horizon": 15}


@pytest.mark.parametrize(("change", "expected"), [
    ({"log_period": 1e-6}, "log_period = 1e-06: must be at least 2e-05 s, or the duration shorter: "
                           "20 s would take about 80 GB of memory"),
    ({"max_step_size": 1e-7}, "simulator.max_step_size = 1e-07: must be at least 6.9e-07 s, or the "
                              "duration shorter: 20 s would take about 56 hours"),
    ({"time_step": 1e-6}, "mpc.time_step = 1e-06: must be at least 1e-05 s, or the duration "
                          "shorter: 20 s would take about 83 hours"),
    ({"horizon": 100_000}, "mpc.horizon = 100000: must be at most 1265: one plan would take "
                           "2.5e+04 GB of memory")])
def test_a_size_that_cannot_be_worth_it_is_refused_with_what_it_would_cost(change, expected):
    check_cost(**USUAL)
    with pytest.raises(InvalidParameter) as caught:
        check_cost(**USUAL | change)
    assert str(caught.value) == expected


@pytest.mark.parametrize("change", [
    {"horizon": 10**300}, {"duration": 1e50}, {"log_period": 5e-324}])
def test_an_absurd_size_is_refused_too(change):
    with pytest.raises(InvalidParameter):
        check_cost(**USUAL | change)


@pytest.mark.parametrize("name", shipped_scenarios())
def test_a_run_of_an_hour_is_no_reason_to_refuse_a_shipped_scenario(name):
    assert load_scenario(name, ["duration=3600"]).duration == 3600.0
