"""Tests of `kinematics.disturbance`: w along the task error."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LinearSystem

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.papers.nikou2018.kinematics.disturbance import TaskAdversary
from uvms_drake.plant.adversary import AIM_FROM

BOUND = 0.1


def pushed(adversary, e) -> np.ndarray:
    """Returns w of a `TaskAdversary` at 𝔢."""
    context = adversary.CreateDefaultContext()
    adversary.GetInputPort("e").FixValue(context, e)
    return adversary.get_output_port().Eval(context)


def test_the_task_adversary_pushes_along_the_error_with_all_it_has():
    adversary, rng = TaskAdversary(BOUND), np.random.default_rng(2)
    norms = []
    for size in (1e-12, 1e-6, 1e-3, 1.0):
        for e in size * rng.normal(size=(10, 6)):
            w = pushed(adversary, e)
            norms.append(np.linalg.norm(w))
            if size > 1e-6:
                assert w @ e == pytest.approx(BOUND * np.linalg.norm(e), rel=1e-5)
    assert np.max(norms) <= BOUND
    np.testing.assert_allclose(norms, BOUND, rtol=1e-12)


def test_where_there_is_no_task_error_it_pushes_along_the_fixed_direction():
    direction = np.arange(1.0, 7.0)
    unit = direction / np.linalg.norm(direction)
    adversary = TaskAdversary(BOUND, direction)
    np.testing.assert_allclose(pushed(adversary, np.zeros(6)), BOUND * unit, rtol=1e-12)
    np.testing.assert_allclose(pushed(TaskAdversary(BOUND), np.zeros(6)), BOUND / np.sqrt(6.0))
    halfway = pushed(adversary, AIM_FROM * np.roll(unit, 1))
    np.testing.assert_allclose(halfway @ unit, halfway @ np.roll(unit, 1), rtol=1e-9)
    assert np.linalg.norm(pushed(adversary, -AIM_FROM * unit)) <= BOUND  # where the two cancel


def test_the_task_adversary_drives_an_error_to_the_solution_of_the_comparison():
    """𝔢̇ = −σ𝔢 + w takes ‖𝔢‖ to w̃(1 − e^{−σt})/σ."""
    sigma, builder = 2.0, DiagramBuilder()
    error = builder.AddSystem(LinearSystem(-sigma * np.eye(6), np.eye(6), np.eye(6), []))
    adversary = TaskAdversary.AddToBuilder(
        builder, BOUND, np.eye(6)[3], e=error.get_output_port(), name="worst")
    assert adversary.get_name() == "worst"
    builder.Connect(adversary.get_output_port(), error.get_input_port())
    simulator = Simulator(builder.Build())
    simulator.get_mutable_integrator().set_target_accuracy(1e-9)
    simulator.AdvanceTo(1.0)
    e = error.get_output_port().Eval(error.GetMyContextFromRoot(simulator.get_context()))
    np.testing.assert_allclose(
        e, BOUND * (1.0 - np.exp(-sigma)) / sigma * np.eye(6)[3], atol=1e-8)


@pytest.mark.parametrize(("arguments", "message"), [
    ((-0.1,), r"^bound = -0\.1: must be zero or positive$"),
    ((0.1, np.ones(10)), r"^direction = .*: must be 6 finite numbers$")])
def test_bad_parameters_of_the_task_adversary_are_named(arguments, message):
    with pytest.raises(InvalidParameter, match=message):
        TaskAdversary(*arguments)
