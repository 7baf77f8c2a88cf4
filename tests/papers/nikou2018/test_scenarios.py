"""The paper's simulation and its claim, as shipped scenarios."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support import dh
from support.quick import FEW, search_less

import uvms_drake as uv
from uvms_drake.certificate.certify import certified_once
from uvms_drake.command.main import main
from uvms_drake.papers.nikou2018 import kinematics
from uvms_drake.papers.nikou2018.kinematic_certificate import certify
from uvms_drake.papers.nikou2018.kinematic_run import FIGURES, summarise
from uvms_drake.report.summary import summarise as summarise_record
from uvms_drake.station.simulation import simulate as simulate_station

CHI_0 = np.array([-1.0, 1.3, -1.0, 0.0, -np.pi / 8, np.pi / 12])
CHI_DES = np.array([0.0, 0.0, 0.0, np.pi / 3, np.pi / 10, 0.0])
W_BOUND = 0.2 * np.sqrt(6.0)


@pytest.fixture(scope="module")
def printed() -> kinematics.Run:
    return kinematics.simulate(uv.load_scenario("paper_kinematic"))


# The parts ----------------------------------------------------------------------------------------


def test_the_robot_moves_as_the_papers_table_says():
    """χ̇ = J(𝔮)ζ + w, by differences of the forward kinematics typed again; the joints as asked."""
    robot = kinematics.DisturbedKinematics("girona500_arm5e", np.zeros(10), np.zeros(3))
    rng = np.random.default_rng(1)
    for _ in range(5):
        config = np.concatenate([rng.uniform(-0.5, 0.5, 6), [0.2, 0.9, 0.3, 0.4]])
        zeta, w = rng.normal(size=10), rng.normal(size=6)
        context = robot.CreateDefaultContext()
        context.SetContinuousState(config)
        for name, value in (("zeta", zeta), ("disturbance", w)):
            robot.GetInputPort(name).FixValue(context, value)
        rate = robot.EvalTimeDerivatives(context).CopyToVector()
        still = uv.configuration_rate(config, zeta)
        chi_dot, without_w = ((dh.chi(config + 1e-6 * each) - dh.chi(config - 1e-6 * each)) / 2e-6
                              for each in (rate, still))
        np.testing.assert_allclose(chi_dot, without_w + w, atol=1e-6)
        np.testing.assert_allclose(rate[6:], zeta[6:], atol=1e-12)


@pytest.mark.parametrize(("law", "rate"), [
    ("!Resolved {sigma: 3.0}", lambda J, e: -3.0 * e),
    ("!Transpose {sigma: 3.0, joints: true}", lambda J, e: -3.0 * J @ J.T @ e)])
def test_the_error_falls_as_the_theory_says(law, rate):
    """ẏ − ȳ̇ at ζ̄ = 0 and 𝔮 near 𝔮̄, where J_x(𝔮) is J_x(𝔮̄)."""
    scenario = uv.load_scenario("paper_kinematic", [f"ancillary={law}"])
    model, y_des, _ = kinematics.posed(scenario)
    nominal, e = model.configuration(y_des), 1e-6 * np.arange(1.0, 11.0)
    J = model.task_jacobian(nominal)
    zeta = kinematics.velocity(scenario.ancillary, model, model.configuration(y_des + e), nominal,
                    np.zeros(10))
    np.testing.assert_allclose(J @ zeta, rate(J, e), atol=1e-9)


def test_a_plan_without_active_limits_is_that_of_a_riccati_recursion():
    """One convex program near the task, where motion is linear: the regulator of its cost."""
    scenario = uv.load_scenario("paper_kinematic_certified", ["mpc.horizon=6"])
    model, y_des, bounds = kinematics.posed(scenario)
    mpc = kinematics.KinematicMpc(model, scenario.mpc, y_des, bounds.tightened(scenario.tube))
    xi, h, J = 1e-4 * np.cos(np.arange(10.0)), 0.1, model.task_jacobian(model.configuration(y_des))
    P, gains = mpc.terminal.P, []
    for _ in range(6):
        gains.append(-np.linalg.solve(h * mpc.R + h * h * J.T @ P @ J, h * J.T @ P))
        closed = np.eye(10) + h * J @ gains[-1]
        P = h * mpc.Q + h * gains[-1].T @ mpc.R @ gains[-1] + closed.T @ P @ closed
    plan = mpc.solve(mpc.resting(model.configuration(y_des + xi)), 5)
    expected = []
    for gain in reversed(gains):
        expected.append(gain @ xi)
        xi = xi + h * J @ expected[-1]
    np.testing.assert_allclose(plan.zeta, expected, atol=1e-6)


# The simulation -----------------------------------------------------------------------------------


@pytest.mark.long
def test_it_goes_from_the_printed_start_to_the_printed_task(printed):
    np.testing.assert_allclose(uv.pose_difference(printed.chi[0], CHI_0), 0.0, atol=2e-3)
    np.testing.assert_allclose(printed.chi_des, CHI_DES, atol=1e-9)
    w = 0.2 * np.sin(printed.time)[:, None] * np.ones(6)
    np.testing.assert_allclose(printed.disturbance, w, atol=1e-12)
    error = np.linalg.norm(uv.pose_difference(printed.chi, CHI_DES), axis=1)
    assert error[0] > 2.0
    assert np.linalg.norm(uv.pose_difference(printed.chi_nominal[-1], CHI_DES)) < 0.03
    assert np.max(error[printed.time > 4.0]) < 0.3  # the printed radius
    summary = summarise(printed, certified=False)
    assert summary["kept"] and min(summary["margins"].values()) > 0.0
    assert {"nu1", "qdot", "tip_pitch", "q4"} <= set(summary["margins"])


@pytest.mark.long
@pytest.mark.parametrize(("disturbance", "duration", "reached"), [
    ("!ConstantDisturbance {bound: 0.4898979485566356}", 6, 0.99),
    ("!ConstantDisturbance {bound: 0.4898979485566356, direction: [1, -2, 1, 0.5, 1, -1]}",
     2.5, 0.99),
    ("!SinusoidalDisturbance {bound: 0.4898979485566356, frequency: 1.0}", 2.5, 0.9)])
def test_the_certified_variant_stays_in_its_tube(disturbance, duration, reached, monkeypatch):
    """For any w at the true bound; a w that reaches the bound shows that it is tight."""
    search_less(monkeypatch)
    scenario = uv.load_scenario("paper_kinematic_certified", [
        *FEW, f"disturbance={disturbance}", f"duration={duration}"])
    assert scenario.disturbance.bound == pytest.approx(W_BOUND)
    certificate = certify(scenario)
    assert certificate.certified, certificate.text
    run = kinematics.simulate(certificate.applied_to(scenario))
    summary = summarise(run, certified=True)
    assert summary["kept"] and min(summary["margins"].values()) > 0.0
    e = summary["tube"]["e"]
    assert reached < e["worst"] / e["radius"] <= 1.001
    if duration == 6:
        assert np.linalg.norm(uv.pose_difference(run.chi_nominal[-1], CHI_DES)) < 0.03


@pytest.mark.parametrize(("override", "expected"), [
    ("mpc.terminal_set=false", "mpc.terminal_set"), ("limits.nu2=0.5", "tube in limits.nu2"),
    ("mpc.horizon=7", "first plan, distance to the terminal set"),
    ("ancillary=!Transpose {sigma: 10.0}", "σJ̲, above L_c")])
def test_it_is_not_certified_without_what_the_theorem_needs(override, expected, monkeypatch):
    search_less(monkeypatch)
    certificate = certify(uv.load_scenario("paper_kinematic_certified", [*FEW, override]))
    assert next(each for each in certificate.conditions if not each.holds).name.startswith(expected)


@pytest.mark.long
def test_a_task_at_the_pitch_limit_is_held_by_the_limit():
    """The tip is asked to a pitch just inside the limit and pushed at; nothing is not a number."""
    limit = 1.45
    pitch = limit - 0.06  # downwards, where the arm reaches with the vehicle level
    run = kinematics.simulate(uv.load_scenario("paper_kinematic", [
        f"task.force=[0, 0, 0, 0.3, {-pitch}, 0]", f"limits.tip_pitch={limit}",
        f"task.posture=[0, {0.5 * np.pi - pitch - 0.05}, 0.05, 0.3]",
        "tube.e=0.05", "ancillary=!Resolved {sigma: 20.0}",
        "disturbance=!ConstantDisturbance {bound: 0.4899, direction: [0, 0, 0, 0, -1, 0]}"]))
    assert all(np.all(np.isfinite(value)) for value in run.arrays().values())
    assert np.max(np.abs(run.chi_nominal[:, 4])) <= limit - 0.05 + 1e-6
    assert limit - 0.1 < np.max(np.abs(run.chi[:, 4])) <= limit


def test_a_push_through_the_singular_pitch_stops_the_run_with_one_line():
    scenario = uv.load_scenario("paper_kinematic", [
        "task.force=[0, 0, 0, 0.3, -1.35, 0]", "task.posture=[0, 0.15, 0.05, 0.3]",
        "tube.e=0.05", "ancillary=!Resolved {sigma: 0.2}", "limits.tip_pitch=1.45",
        "disturbance=!ConstantDisturbance {bound: 0.7, direction: [0, 0, 0, 0, -1, 0]}"])
    with pytest.raises(uv.RunFailed, match="pitch") as caught:
        kinematics.simulate(scenario)
    assert "\n" not in str(caught.value)


def test_the_commands_write_log_summary_and_figures(tmp_path, capsys):
    short = ["--quiet", "--set", "duration=0.2", "--set", "mpc.horizon=3"]
    folder = tmp_path / "run"
    assert main(["run", "paper_kinematic", "--uncertified", "--output", str(folder), *short]) == 0
    assert "without a certificate" in capsys.readouterr().out
    assert {*FIGURES, "log.npz", "scenario.yaml", "summary.json"} <= {
        path.name for path in folder.iterdir()}
    assert json.loads((folder / "summary.json").read_text())["scenario"] == "paper_kinematic"
    assert main(["certify", "paper_kinematic", "--output", str(tmp_path / "c"), *short,
                 "--set", FEW[0]]) == 1
    assert "NOT certified" in capsys.readouterr().out


@pytest.mark.parametrize(("override", "expected"), [
    ("current=[0.1, 0, 0]", "current"), ("model_error.mass=0.1", "model_error"),
    ("disturbance=!AdversarialDisturbance {bound: 0.1}", "disturbance"),
    ("ancillary=!TipFirst {}", "ancillary"), ("mpc.weight_y=[0,1,1,1,1,1,1,1,1,1]", "weight_y"),
    ("tube.e=1.5", "tube"),
    ("faults=[!SolverFailure {}]", "faults")])
def test_what_has_no_meaning_there_is_refused(override, expected):
    with pytest.raises(ValueError, match=expected):
        kinematics.simulate(uv.load_scenario("paper_kinematic", [override]))


# The claim, in dynamics ---------------------------------------------------------------------------


@pytest.mark.long
def test_the_papers_claim_holds_in_dynamics_with_this_projects_law():
    record = simulate_station(uv.load_scenario(
        "paper_dynamic_resolved", ["simulator.max_step_size=0.05"]))
    summary = summarise_record(record)
    assert summary["task_error"]["final_norm"] < 0.01
    assert min(row["margin"] for row in summary["constraints"].values()) > 0.0
    assert (summary["tube"]["exits"], summary["tube"]["exits_along_the_run"]) == (0, 0)
    assert summary["mpc"]["fallbacks"] == 0


@pytest.mark.long
def test_the_papers_own_law_corrected_is_certified_and_keeps_its_tube(monkeypatch):
    """At the gain that its conditions ask for; the implicit integrator carries it."""
    search_less(monkeypatch)
    scenario = uv.load_scenario("paper_dynamic", ["duration=1.2", *FEW])
    certificate = certified_once(scenario)
    assert certificate.certified, certificate.failed
    assert (certificate.law, certificate.k) == ("transpose", 10000.0)
    record = simulate_station(certificate.applied_to(scenario), certified=True)
    summary = summarise_record(record)
    tube = summary["tube"]
    assert tube["exits"] == 0
    assert min(row["margin"] for row in summary["constraints"].values()) > 0.0
    assert 0.0 < tube["worst_e"] < tube["bound_e"] < 1e-4
    one_less = replace(scenario, ancillary=replace(scenario.ancillary, k=7000.0))
    assert not certified_once(one_less).certified
