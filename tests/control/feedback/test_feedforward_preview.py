"""Tests of `control.feedback.feedforward_preview`."""

import numpy as np
import pytest
from pydrake.common.value import Value
from support.lagging import CONFIG, Motion, run
from support.transfer import impulse

import uvms_drake as uv
from uvms_drake.control.feedback.feedforward_preview import (
    FeedforwardPreview,
    SurfaceReaction,
    previewed_forces,
)
from uvms_drake.control.laws.tip_first import BlockGains
from uvms_drake.control.mpc.planner import committed_intervals
from uvms_drake.control.plan.plan import Plan
from uvms_drake.model.signals.command_path import IDEAL_PATH
from uvms_drake.station.scenario.parts import command_path_of

H, N = 0.2, 6
GAINS = (1.5, 0.4)  # k, σ of the vehicle [1/s]
PATH = uv.CommandPath(delay=0.04, dead_time=0.1, lag=0.16)  # s; vehicle 0.3, joints 0.04


def jumping(before: int = 0) -> Plan:
    """A plan that speeds up, brakes, and speeds up again, all coordinates at once.

    It hovers for some intervals before.
    """
    size = np.array([0.2, -0.2, 0.2, 0.1, 0.1, -0.1, 0.4, 0.4, -0.4, 0.4])
    zeta_dot = np.outer([0.0] * before + [1.0, 1.0, 0.8, -0.5, -0.5, 0.1], size)
    return Plan.from_accelerations(0.0, H, CONFIG, np.zeros(10), zeta_dot)


def planned_forces(model, plan: Plan, time: float) -> np.ndarray:
    """Returns τ̄ (10,) by M ζ̄̇ − M f."""
    config, zeta, zeta_dot = plan.at(time)
    return model.mass_matrix(model.kinematics(config)) @ (zeta_dot - model.drift(config, zeta))


def test_it_is_what_the_plans_forces_change_until_they_act(model):
    plan, time, delay = jumping(), 0.25, (0.3, 0.04)
    preview = previewed_forces(model, plan, time, delay, plan.at(time))
    now = planned_forces(model, plan, time)
    np.testing.assert_allclose(preview[:6], planned_forces(model, plan, 0.55)[:6] - now[:6],
                               atol=1e-9)
    np.testing.assert_allclose(preview[6:], planned_forces(model, plan, 0.29)[6:] - now[6:],
                               atol=1e-9)
    # After the end the last forces are used; without a delay the preview is zero.
    np.testing.assert_array_equal(*(
        previewed_forces(model, plan, time, (vehicle, 0.0), plan.at(time))[:6]
        for vehicle in (N * H - time, 9.0)))
    assert not previewed_forces(model, plan, time, (0.0, 0.0), plan.at(time)).any()


def test_of_an_unknown_wall_it_is_the_change_of_the_planned_force(model):
    """With stiffness and inclination, deeper or less deep; never less than no force at all."""
    plan, time, delay = jumping(), 0.25, (0.3, 0.04)
    n, inclined = np.array([0.6, 0.0, 0.8]), np.array([0.6, 0.1, 0.8])
    tips, jacobians = (np.array([of(plan.at(time + each)[0])[:3] for each in (0.0, *delay)])
                       for of in (model.task_pose, model.task_jacobian))
    deeper = (tips - tips[0]) @ inclined
    free = previewed_forces(model, plan, time, delay, plan.at(time))
    for force, slope, cut in ((8.0, 500.0, False), (8.0, -500.0, False), (2.0, -500.0, True)):
        along = force + slope * deeper
        assert np.any(along < 0.0) == cut
        torques = np.maximum(along, 0.0)[:, None] * (n @ jacobians)
        more = previewed_forces(model, plan, time, delay, plan.at(time),
                            SurfaceReaction(n, force, slope * inclined)) - free
        np.testing.assert_allclose(more, np.append(
            torques[1, :6] - torques[0, :6], torques[2, 6:] - torques[0, 6:]), atol=1e-9)
        assert np.linalg.norm(more[:6]) > 1.0


def test_only_a_law_that_takes_the_wrench_has_a_preview(short_ocp):
    path = uv.CommandPath(delay=0.02, dead_time=0.08, lag=0.15)
    assert committed_intervals(uv.laws.TipFirst(), path, H) == 2
    assert committed_intervals(uv.laws.TipFirst(), path._replace(lag=0.3), H) == 2
    for law, none in ((uv.Resolved(), path), (uv.laws.TipFirst(), IDEAL_PATH)):
        assert committed_intervals(law, none, H) == 0
        assert not uv.make_tube_mpc(short_ocp, law, command_path=none).HasSubsystemNamed(
            "previewed_forces")
    controller = uv.make_tube_mpc(short_ocp, uv.laws.TipFirst(), command_path=path)
    preview, feedback = (controller.GetSubsystemByName(name) for name in (
        "previewed_forces", "ancillary"))
    assert controller.AreConnected(preview.get_output_port(), feedback.GetInputPort("preview"))


def test_the_delay_is_the_sum_of_the_parts_of_the_actuation(model):
    scenario = uv.load_scenario("girona500_ideal", [
        "actuation=[!SampledCommand {period: 0.02, delay: 0.01}, "
        "!Thrusters {lag: 0.1, dead_time: 0.05, period: 0.01}]"])
    np.testing.assert_allclose(
        command_path_of(scenario.actuation, model).preview, [0.02 + 0.155, 0.02])
    for actuation in ([], uv.load_scenario("girona500_ideal", [
            "actuation=[!SampledCommand {}]"]).actuation):
        assert command_path_of(actuation, model).preview == (0.0, 0.0)


def test_as_a_system_it_reads_the_plan_and_the_contact_state(model):
    n, tilt = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.02, 0.01])
    plan = jumping()
    config, zeta, zeta_dot = plan.at(0.25)
    for system in FeedforwardPreview(model, PATH), FeedforwardPreview(model, PATH, n):
        context = system.CreateDefaultContext()
        context.SetTime(0.25)
        for name, value in (("plan", Value(plan)), ("nominal_state", np.append(config, zeta)),
                            ("nominal_acceleration", zeta_dot), ("reading", [0.1, 0.2, 0.3, 6.0]),
                            ("stiffness_used", [400.0]), ("tilt", tilt), ("force_lost", [0.0])):
            if system.HasInputPort(name):
                system.GetInputPort(name).FixValue(context, value)
        if not system.HasInputPort("touched"):
            np.testing.assert_array_equal(system.get_output_port().Eval(context), previewed_forces(
                model, plan, 0.25, PATH.preview, plan.at(0.25)))
    for touched, pressed in ((0.0, None), (1.0, SurfaceReaction(n, 6.0, 400.0 * (n + tilt)))):
        system.GetInputPort("touched").FixValue(context, [touched])
        np.testing.assert_array_equal(system.get_output_port().Eval(context), previewed_forces(
            model, plan, 0.25, PATH.preview, plan.at(0.25), pressed))
    system.GetInputPort("force_lost").FixValue(context, [1.0])
    np.testing.assert_array_equal(system.get_output_port().Eval(context), previewed_forces(
        model, plan, 0.25, PATH.preview, plan.at(0.25)))


@pytest.mark.slow
def test_on_the_full_dynamics_it_leaves_what_the_rows_say(model):
    """A plan that hovers, and then speeds up, behind a lag of 0.1 s.

    The vehicle's errors are within the bound of (e^{sT} − 1 − Ts)/Δ, and several times as large if
    there is no preview.
    """
    lag, plan = 0.1, jumping(before=1)
    law = uv.laws.TipFirst(BlockGains(*GAINS), BlockGains(20.0, 10.0))

    def nominal(time: float) -> tuple[np.ndarray, np.ndarray]:
        config, zeta, zeta_dot = plan.at(time)
        return np.append(config, zeta), zeta_dot

    def preview(time: float) -> np.ndarray:
        return previewed_forces(model, plan, time, (lag, 0.0), plan.at(time))

    def moved(**settings) -> Motion:
        return run(model, law, lambda time, J: np.zeros(10), 1.0, plan=nominal, lag=lag, **settings)

    previewed, plain = moved(preview=preview), moved()
    e, largest = previewed.error[:, :6], np.max(np.abs(plain.error[:, :6]), axis=0)
    f = np.einsum("tij,tj->ti", plain.carried, plain.asked[:, :6]) - plain.feedback[:, :6]
    assert np.all(np.max(np.abs(e), axis=0) < 0.2 * largest)
    assert np.max(np.abs(previewed.error[:, 6:])) < 1e-4  # the tip
    # ∫|(e^{sT} − 1 − Ts)/Δ|, whose impulse response begins at −T.
    k, sigma = GAINS[:2]
    delta, t = [lag, 1.0, k + sigma, k * sigma], np.linspace(-lag, 30.0, 100_001)
    response = (np.where(t > -lag, impulse([1.0], delta, t + lag), 0.0)
                - np.where(t > 0.0, impulse([lag, 1.0], delta, t), 0.0))
    gain = np.trapezoid(np.abs(response), t)
    assert np.all(np.max(np.abs(e), axis=0) <= 1.1 * gain * 0.5 * np.ptp(f, axis=0))
