"""Tests of `uvms_drake.control.input_map`."""

import numpy as np
import pytest

from uvms_drake.control.input_map import InputMap
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state


def tau(forces: InputMap, state: np.ndarray, u: np.ndarray) -> np.ndarray:
    context = forces.CreateDefaultContext()
    forces.GetInputPort("state").FixValue(context, state)
    forces.GetInputPort("u").FixValue(context, u)
    return forces.GetOutputPort("tau").Eval(context)


@pytest.mark.parametrize("where", ["free", "deep"])
def test_the_plant_accelerates_by_u_more_than_without_it(model, plane, states, where):
    """ζ̇ = f + u: the full inertia, with added mass and rotors, on both sides."""
    plant = make_uvms_plant(model="girona500_arm5e", surface=plane,
                            disturbance=ConstantDisturbance(bound=0.0))
    water = plant.GetSubsystemByName("hydrodynamics")
    order = plant.GetSubsystemByName("tau_to_drake_order")
    context = plant.CreateDefaultContext()
    forces = InputMap(model)
    rng = np.random.default_rng(0)
    for state in states[where]:
        u = rng.normal(size=10)
        set_state(plant, context, state)

        def accelerate(force, context=context):
            plant.GetInputPort("tau").FixValue(context, force)
            return water.GetOutputPort("acceleration").Eval(
                water.GetMyContextFromRoot(context)).copy()

        gained = accelerate(tau(forces, state, u)) - accelerate(np.zeros(10))
        accelerate(u)  # The same map takes u into the plant's order.
        expected = order.GetOutputPort("drake_order").Eval(order.GetMyContextFromRoot(context))
        np.testing.assert_allclose(gained, expected, atol=1e-9)


def test_the_force_is_linear_in_u_and_independent_of_velocity(model, states):
    forces = InputMap(model)
    state = states["deep"][0]
    u = np.linspace(-1.0, 1.0, 10)
    other = np.concatenate([state[:10], np.zeros(10)])
    np.testing.assert_allclose(
        tau(forces, state, -2.0 * u), -2.0 * tau(forces, other, u), rtol=1e-12)
    np.testing.assert_array_equal(tau(forces, state, np.zeros(10)), np.zeros(10))


def test_the_system_has_no_state(model):
    assert InputMap(model).CreateDefaultContext().num_total_states() == 0
