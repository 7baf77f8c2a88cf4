"""The paper's simulation and its claim, as shipped scenarios."""

from dataclasses import replace

import numpy as np
import pytest
from support.quick import FEW, search_less

from uvms_drake.certificate.certify import certified_once
from uvms_drake.common.errors import RunFailed
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.report.summary import summarise
from uvms_drake.station.record import Record
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.simulation import simulate

pytestmark = pytest.mark.long

CHI_0 = np.array([-1.0, 1.3, -1.0, 0.0, -np.pi / 8, np.pi / 12])
CHI_DES = np.array([0.0, 0.0, 0.0, np.pi / 3, np.pi / 10, 0.0])
W_BOUND = 0.2 * np.sqrt(6.0)


@pytest.fixture(scope="module")
def printed() -> Record:
    return simulate(load_scenario("paper_kinematic"))


def test_it_goes_from_the_printed_start_to_the_printed_task(printed):
    np.testing.assert_allclose(pose_difference(printed.chi[0], CHI_0), 0.0, atol=2e-3)
    np.testing.assert_allclose(printed.chi_des, CHI_DES, atol=1e-9)
    w = 0.2 * np.sin(printed.time)[:, None] * np.ones(6)
    np.testing.assert_allclose(printed.disturbance, w, atol=1e-12)


def test_the_errors_converge_within_6_seconds_to_within_the_tube(printed):
    error = np.linalg.norm(pose_difference(printed.chi, CHI_DES), axis=1)
    nominal = np.linalg.norm(pose_difference(printed.chi_nominal, CHI_DES), axis=1)
    assert error[0] > 2.0
    assert nominal[-1] < 0.03
    assert np.max(error[printed.time > 4.0]) < 0.3  # the printed radius
    assert np.max(printed.deviation_of("task")) < 0.3


def test_its_limits_are_kept(printed):
    margins = {name: row["margin"] for name, row in summarise(printed)["constraints"].items()}
    assert min(margins.values()) > 0.0
    assert {"nu1", "nu2", "qdot", "q1_min", "q4_max", "tip_pitch"} <= set(margins)


def test_it_stays_within_the_bound_along_the_run(printed):
    tube = summarise(printed)["tube"]
    assert tube["exits_along_the_run"] == 0
    assert 0.2 < tube["worst_ratio"]["trajectory"] < 1.0


@pytest.mark.parametrize(("disturbance", "duration", "reached"), [
    ("!ConstantDisturbance {bound: 0.4898979485566356}", 6, 0.99),
    ("!ConstantDisturbance {bound: 0.4898979485566356, direction: [1, -2, 1, 0.5, 1, -1]}",
     2.5, 0.99),
    ("!SinusoidalDisturbance {bound: 0.4898979485566356, frequency: 1.0}", 2.5, 0.9),
    ("!AdversarialDisturbance {bound: 0.4898979485566356, kind: along_task_error}", 2.5, 0.99),
])
def test_the_certified_variant_stays_in_its_tube(disturbance, duration, reached, monkeypatch):
    """For any w at the true bound; a w that reaches the bound shows that it is tight.

    The nominal motion is the same whatever w does, so that it has to arrive in one of the runs.
    """
    search_less(monkeypatch)
    scenario = load_scenario("paper_kinematic_certified", [
        *FEW, f"disturbance={disturbance}", f"duration={duration}"])
    assert scenario.disturbance.bound == pytest.approx(W_BOUND)
    certificate = certified_once(scenario)
    assert certificate.certified
    record = simulate(certificate.applied_to(scenario), certified=True)
    summary = summarise(record)
    assert (summary["tube"]["exits"], summary["tube"]["exits_along_the_run"]) == (0, 0)
    assert reached < summary["tube"]["worst_e"] / summary["tube"]["bound_e"] <= 1.001
    assert min(row["margin"] for row in summary["constraints"].values()) > 0.0
    assert summary["mpc"]["worst_terminal_slack"] < 1e-6
    if duration == 6:
        assert np.linalg.norm(pose_difference(record.chi_nominal[-1], CHI_DES)) < 0.03


def test_a_task_at_the_pitch_limit_is_held_by_the_limit():
    """The tip is asked to a pitch just inside the limit and pushed at; nothing is not a number."""
    limit = 1.45
    pitch = limit - 0.06  # downwards, where the arm reaches with the vehicle level
    scenario = load_scenario("paper_kinematic", [
        f"task.force=[0, 0, 0, 0.3, {-pitch}, 0]", f"limits.tip_pitch={limit}",
        f"task.posture=[0, {0.5 * np.pi - pitch - 0.05}, 0.05, 0.3]",
        "tube.e=0.05", "ancillary=!Resolved {sigma: 20.0}",
        "disturbance=!ConstantDisturbance {bound: 0.4899, direction: [0, 0, 0, 0, -1, 0]}"])
    record = simulate(scenario)
    for name in ("state", "nominal_state", "chi", "u"):
        assert np.all(np.isfinite(getattr(record, name)))
    assert np.max(np.abs(record.chi_nominal[:, 4])) <= limit - 0.05 + 1e-6
    assert limit - 0.1 < np.max(np.abs(record.chi[:, 4])) <= limit


def test_a_push_through_the_singular_pitch_stops_the_run_with_one_line():
    scenario = load_scenario("paper_kinematic", [
        "task.force=[0, 0, 0, 0.3, -1.35, 0]", "task.posture=[0, 0.15, 0.05, 0.3]",
        "tube.e=0.05", "ancillary=!Resolved {sigma: 0.2}", "limits.tip_pitch=1.45",
        "disturbance=!ConstantDisturbance {bound: 0.7, direction: [0, 0, 0, 0, -1, 0]}"])
    with pytest.raises(RunFailed, match="pitch") as caught:
        simulate(scenario)
    assert "\n" not in str(caught.value)


def test_the_papers_claim_holds_in_dynamics_with_this_projects_law():
    record = simulate(load_scenario(
        "paper_dynamic_resolved", ["simulator.max_step_size=0.05"]))
    summary = summarise(record)
    assert summary["task_error"]["final_norm"] < 0.01
    assert min(row["margin"] for row in summary["constraints"].values()) > 0.0
    assert (summary["tube"]["exits"], summary["tube"]["exits_along_the_run"]) == (0, 0)
    assert summary["mpc"]["fallbacks"] == 0


def test_the_papers_own_law_corrected_is_certified_and_keeps_its_tube(monkeypatch):
    """At the gain that its conditions ask for; the implicit integrator carries it."""
    search_less(monkeypatch)
    scenario = load_scenario("paper_dynamic", ["duration=1.2", *FEW])
    certificate = certified_once(scenario)
    assert certificate.certified, certificate.failed
    assert (certificate.law, certificate.k) == ("transpose", 10000.0)
    record = simulate(certificate.applied_to(scenario), certified=True)
    summary = summarise(record)
    tube = summary["tube"]
    assert tube["exits"] == 0
    assert min(row["margin"] for row in summary["constraints"].values()) > 0.0
    assert 0.0 < tube["worst_e"] < tube["bound_e"] < 1e-4
    one_less = replace(scenario, ancillary=replace(scenario.ancillary, k=7000.0))
    assert not certified_once(one_less).certified
