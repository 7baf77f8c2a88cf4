"""Tests of `papers.nikou2018.kinematics.feedback`."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.laws import Resolved, TipFirst
from uvms_drake.control.mpc.nominal_mpc import NominalMpc
from uvms_drake.control.ocp.scp import SequentialConvexSolver
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.papers.nikou2018 import Transpose
from uvms_drake.papers.nikou2018.kinematics.feedback import KinematicFeedback
from uvms_drake.papers.nikou2018.kinematics.laws import velocity_law
from uvms_drake.station.motions.motions import make_ocp
from uvms_drake.station.scenario.scenario import load_scenario

SIGMA = 3.0


@pytest.fixture(scope="module")
def ocp():
    return make_ocp(load_scenario("paper_kinematic"))


@pytest.fixture
def states(ocp) -> tuple[np.ndarray, np.ndarray]:
    """𝔮 and (𝔮̄, ζ̄), some centimetres apart."""
    rng = np.random.default_rng(0)
    nominal = ocp.model.configuration(ocp.y_des + rng.uniform(-0.2, 0.2, size=10))
    config = nominal + rng.uniform(-0.05, 0.05, size=10)
    return config, np.concatenate([nominal, rng.uniform(-0.5, 0.5, size=10)])


def velocity(law, *arguments) -> np.ndarray:
    """Returns the command ζ of a law."""
    return velocity_law(law).velocity(law, *arguments)


def error_rate(model, config, nominal_state, zeta, derivative) -> np.ndarray:
    """Returns 𝔢̇_y without a disturbance, by differences along both motions."""
    nominal, nominal_zeta = np.split(nominal_state, 2)

    def error(t: float) -> np.ndarray:
        real = model.task_pose(config + t * configuration_rate(config, zeta))
        ideal = model.task_pose(nominal + t * configuration_rate(nominal, nominal_zeta))
        return pose_difference(real, ideal)

    return derivative(error, 1e-5)


def test_the_resolved_law_leaves_a_linear_error_equation(ocp, states, derivative):
    config, nominal_state = states
    zeta = velocity(Resolved(sigma=SIGMA), ocp.model, config, nominal_state)
    error = pose_difference(ocp.model.task_pose(config), ocp.model.task_pose(nominal_state[:10]))
    np.testing.assert_allclose(
        error_rate(ocp.model, config, nominal_state, zeta, derivative), -SIGMA * error, atol=1e-7)


def test_the_transpose_law_leaves_what_the_paper_derives(ocp, states, derivative):
    config, nominal_state = states
    zeta = velocity(Transpose(sigma=SIGMA), ocp.model, config, nominal_state)
    J, J_bar = (ocp.model.task_jacobian(q)[:6] for q in (config, nominal_state[:10]))
    error = pose_difference(
        ocp.model.task_pose(config), ocp.model.task_pose(nominal_state[:10]))[:6]
    expected = (J - J_bar) @ zeta - SIGMA * J_bar @ J_bar.T @ error
    np.testing.assert_allclose(
        error_rate(ocp.model, config, nominal_state, zeta, derivative)[:6], expected, atol=1e-7)


def test_with_joints_the_transpose_law_acts_on_the_whole_configuration(ocp, states, derivative):
    config, nominal_state = states
    zeta = velocity(Transpose(sigma=SIGMA, joints=True), ocp.model, config, nominal_state)
    J, J_bar = (ocp.model.task_jacobian(q) for q in (config, nominal_state[:10]))
    error = pose_difference(ocp.model.task_pose(config), ocp.model.task_pose(nominal_state[:10]))
    expected = (J - J_bar) @ zeta - SIGMA * J_bar @ J_bar.T @ error
    np.testing.assert_allclose(
        error_rate(ocp.model, config, nominal_state, zeta, derivative), expected, atol=1e-7)


@pytest.mark.parametrize("law", [Resolved(sigma=SIGMA), Transpose(sigma=SIGMA)])
def test_on_the_nominal_trajectory_the_command_is_the_nominal_one(ocp, states, law):
    _, nominal_state = states
    np.testing.assert_allclose(
        velocity(law, ocp.model, nominal_state[:10], nominal_state), nominal_state[10:],
        atol=1e-12)


@pytest.mark.parametrize("law", [Resolved(sigma=SIGMA), Transpose(sigma=SIGMA)])
def test_the_system_puts_out_the_law(ocp, states, law):
    system = KinematicFeedback(ocp.model, law)
    context = system.CreateDefaultContext()
    for name, value in zip(("configuration", "nominal_state"), states, strict=True):
        system.GetInputPort(name).FixValue(context, value)
    np.testing.assert_array_equal(
        system.GetOutputPort("zeta").Eval(context), velocity(law, ocp.model, *states))


@pytest.mark.parametrize("config", [Resolved(sigma=SIGMA), Transpose(sigma=SIGMA)])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_without_a_measurement_the_command_is_the_plans_own(ocp, states, config, value):
    measured, nominal_state = states[0].copy(), states[1]
    system = KinematicFeedback(ocp.model, config)
    context = system.CreateDefaultContext()
    system.GetInputPort("nominal_state").FixValue(context, nominal_state)
    for index in (0, 9):
        system.GetInputPort("configuration").FixValue(context, measured)
        assert system.GetOutputPort("lost").Eval(context) == 0.0
        lost = measured.copy()
        lost[index] = value
        system.GetInputPort("configuration").FixValue(context, lost)
        assert system.GetOutputPort("lost").Eval(context) == 1.0
        np.testing.assert_allclose(
            system.GetOutputPort("zeta").Eval(context), nominal_state[10:], atol=1e-12)


def test_it_is_connected_to_the_nominal_mpc(ocp):
    builder = DiagramBuilder()
    mpc = NominalMpc.AddToBuilder(builder, SequentialConvexSolver(ocp))
    feedback = KinematicFeedback.AddToBuilder(builder, ocp.model, Resolved(), nominal=mpc)
    assert builder.IsConnectedOrExported(feedback.GetInputPort("nominal_state"))
    assert not mpc.HasOutputPort("nominal_acceleration")


def test_a_gain_that_is_not_positive_is_refused(ocp):
    with pytest.raises(InvalidParameter, match="sigma"):
        KinematicFeedback(ocp.model, Resolved(sigma=0.0))


def test_a_law_without_a_velocity_is_refused(ocp):
    with pytest.raises(InvalidParameter, match=(
            r"^ancillary = 'tip-first': must be a law with a velocity")):
        KinematicFeedback(ocp.model, TipFirst())
