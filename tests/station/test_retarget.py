"""Another desired force while it runs, through the station's port `desired_force`."""

import numpy as np
import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from support.quick import FEW

import uvms_drake as uv
from uvms_drake.certificate.certify import certified_once
from uvms_drake.station.problem import retargeted_ocp
from uvms_drake.station.simulation import make_record

FORCES = ((4.0, 30.0), (9.5, 44.0), (10.5, 25.0))
"""From these times on [s] these forces are asked for [N]; the second is more than the tube leaves
of `limits.static_force`."""

pytestmark = [pytest.mark.usefixtures("few_searches"), pytest.mark.long]


@pytest.fixture(scope="module")
def scenario(few_searches) -> uv.Scenario:
    scenario = uv.load_scenario("girona500_ideal", [
        "duration=13.5", "start.eta=[-1.13, -0.05, -0.05, 0.02, 0.02, 0.05]", *FEW])
    return certified_once(scenario).applied_to(scenario)


@pytest.fixture(scope="module")
def record(scenario) -> uv.Record:
    station = uv.make_station(scenario)
    simulator = Simulator(station)
    ApplySimulatorConfig(uv.with_step(scenario).simulator, simulator)
    context = simulator.get_mutable_context()
    for time, force in FORCES:
        simulator.AdvanceTo(time)
        station.GetInputPort("desired_force").FixValue(context, [force, 0.0, 0.0, 0.0, 0.0, 0.0])
    simulator.AdvanceTo(scenario.duration)
    return make_record(
        scenario, uv.load_model(scenario), uv.read_logs(station, context), 1.0, certified=True)


def during(record: uv.Record, start: float, end: float) -> np.ndarray:
    return (record.time > start - 1e-9) & (record.time < end + 1e-9)


def test_the_new_force_is_there_within_5_seconds(record):
    """To within 1 N, from 20 to 30 N and from 30 to 25 N."""
    for start, end, force in ((8.5, 9.5, 30.0), (12.5, 13.5, 25.0)):
        pressed = record.force[during(record, start, end), 0]
        assert np.max(np.abs(pressed - force)) < 1.0


def test_a_force_beyond_its_limit_is_refused_and_the_old_one_kept(record):
    kept = during(record, 9.6, 10.4)
    np.testing.assert_array_equal(record.desired_force[kept, 0], 30.0)
    assert np.max(np.abs(record.force[kept, 0] - 30.0)) < 1.0
    asked = (record.mpc_time > 9.6) & (record.mpc_time < 10.4)
    assert np.all(record.mpc_refused[asked] == 1.0)
    assert not np.any(record.mpc_refused[record.mpc_time < 9.4])


def test_limits_and_tube_are_kept_and_no_plan_leaves_its_terminal_set(record):
    summary = uv.summarise(record)
    assert all(row["margin"] >= 0.0 for row in summary["constraints"].values())
    assert (summary["tube"]["exits"], summary["tube"]["exits_along_the_run"]) == (0, 0)
    assert summary["mpc"]["fallbacks"] == 0
    assert summary["mpc"]["worst_terminal_slack"] < 1e-6
    assert summary["mpc"]["worst_violation"] < 1e-6


def test_a_problem_of_another_force_has_its_own_equilibrium_and_terminal_set(scenario):
    model = uv.load_model(scenario)
    one, other = (retargeted_ocp(scenario, model, np.array([force, 0.0, 0.0, 0.0, 0.0, 0.0]))
                  for force in (20.0, 30.0))
    assert np.linalg.norm(one.u_eq - other.u_eq) > 0.01
    assert np.linalg.norm(one.terminal.P - other.terminal.P) > 0.0
    assert other.y_des[0] - one.y_des[0] == pytest.approx(0.01, abs=2e-3)  # 10 N at 1000 N/m
    assert other.terminal.radius > 0.0
