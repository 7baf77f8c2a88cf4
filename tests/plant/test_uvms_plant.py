"""The assembled plant: its ports, its wiring, and that it moves as its parts say."""

import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder
from support.surfaces import Sphere

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.coordinates import Coordinates
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.surface.spring import BilateralSpring
from uvms_drake.model.uvms import add_uvms
from uvms_drake.plant.disturbance import (
    ConstantDisturbance,
    SinusoidalDisturbance,
)
from uvms_drake.plant.hydrodynamics import Hydrodynamics
from uvms_drake.plant.surface import CompliantSurface, pose_and_jacobian
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state

MODEL = "girona500_arm5e"
FAR_AWAY = UnilateralPlane(point=np.array([100.0, 0.0, 0.0]))
CALM = ConstantDisturbance(bound=0.0)


def make(surface=FAR_AWAY, disturbance=CALM, **kwargs):
    return make_uvms_plant(MODEL, surface=surface, disturbance=disturbance, **kwargs)


def moving_state():
    rng = np.random.default_rng(0)
    eta = np.array([0.4, -1.2, 2.0, 0.1, -0.2, 0.7])
    return np.concatenate([eta, rng.uniform(-0.3, 0.3, 4), rng.uniform(-0.3, 0.3, 10)])


def parts_of(uvms):
    plant = uvms.GetSubsystemByName("plant")
    return plant, uvms.GetSubsystemByName("to_paper_order").coordinates


def simulator_of(uvms, context=None):
    simulator = Simulator(uvms) if context is None else Simulator(uvms, context)
    ResetIntegratorFromFlags(simulator, "runge_kutta3", 0.01)
    simulator.get_mutable_integrator().set_fixed_step_mode(True)
    return simulator


def test_the_diagram_equals_its_parts_wired_by_hand():
    """Force, current, surface and disturbance each arrive once, in the right order and sign."""
    rng = np.random.default_rng(1)
    tau, current = rng.normal(scale=20.0, size=10), np.array([0.2, -0.1, 0.05])
    d = ConstantDisturbance(0.3, rng.normal(size=10))
    spring = BilateralSpring(np.diag([90.0, 80, 70, 3, 2, 1]), np.array([1, -1, 2, 0.1, 0.2, 0.3]))
    uvms = make(spring, d)
    context = uvms.CreateDefaultContext()
    set_state(uvms, context, moving_state())
    uvms.GetInputPort("tau").FixValue(context, tau)
    uvms.GetInputPort("current").FixValue(context, current)
    actual = uvms.EvalTimeDerivatives(context).CopyToVector()

    builder = DiagramBuilder()
    plant = builder.AddNamedSystem("plant", MultibodyPlant(0.0))
    robot = add_uvms(plant, MODEL)
    plant.Finalize()
    coordinates = Coordinates(robot)
    x = coordinates.to_drake(moving_state())
    water = Hydrodynamics.AddToBuilder(builder, plant, robot.hydrodynamics)
    surface = CompliantSurface(plant, robot.tip, spring)
    surface_context = surface.CreateDefaultContext()
    surface.GetInputPort("plant_state").FixValue(surface_context, x)
    push = surface.GetOutputPort("generalized_force").Eval(surface_context)
    by_hand = builder.Build()
    context = by_hand.CreateDefaultContext()
    plant.SetPositionsAndVelocities(plant.GetMyMutableContextFromRoot(context), x)
    water_context = water.GetMyMutableContextFromRoot(context)
    water.GetInputPort("generalized_force").FixValue(
        water_context, push + coordinates.vector_to_drake(x, tau))
    water.GetInputPort("current").FixValue(water_context, current)
    d_paper = d.bound * d.direction / np.linalg.norm(d.direction)
    water.GetInputPort("acceleration_disturbance").FixValue(
        water_context, coordinates.vector_to_drake(x, d_paper))
    expected = by_hand.EvalTimeDerivatives(context).CopyToVector()
    np.testing.assert_allclose(actual, expected, rtol=1e-11, atol=1e-11)


def test_the_disturbance_is_what_is_added_to_the_rate_of_zeta():
    """ζ̇ by central differences of the `state` port along the motion."""
    rates = []
    for bound in (0.0, 0.4):
        uvms = make(disturbance=SinusoidalDisturbance(bound, phase=0.9))
        context = uvms.CreateDefaultContext()
        plant, _ = parts_of(uvms)
        set_state(uvms, context, moving_state())
        plant_context = plant.GetMyMutableContextFromRoot(context)
        d = uvms.GetOutputPort("disturbance").Eval(context)
        x = plant.GetPositionsAndVelocities(plant_context)
        x_dot = uvms.EvalTimeDerivatives(context).CopyToVector()[: len(x)]
        h, ends = 1e-6, []
        for step in (h, -h):
            plant.SetPositionsAndVelocities(plant_context, x + step * x_dot)
            ends.append(uvms.GetOutputPort("state").Eval(context)[10:].copy())
        rates.append((ends[0] - ends[1]) / (2.0 * h))
    assert np.linalg.norm(d) > 0.1
    np.testing.assert_allclose(rates[1] - rates[0], d, atol=1e-7)


def test_the_acceleration_is_the_rate_of_zeta_along_a_trajectory():
    """In a current and in contact, disturbed and driven, by central differences."""
    uvms = make(UnilateralPlane(point=np.array([0.5, 0.0, 0.0]), stiffness=200.0, transition=0.5),
                SinusoidalDisturbance(0.4, phase=0.9))
    simulator = simulator_of(uvms)
    context, step = simulator.get_mutable_context(), 2e-4
    set_state(uvms, context, moving_state())
    tau = [20.0, -10.0, 30.0, 5.0, -5.0, 8.0, 1.0, -1.0, 0.5, 0.01]
    uvms.GetInputPort("tau").FixValue(context, tau)
    uvms.GetInputPort("current").FixValue(context, [0.2, -0.1, 0.05])
    zeta, rates = [], []
    for time in step * np.arange(51):
        simulator.AdvanceTo(time)
        zeta.append(uvms.GetOutputPort("state").Eval(context)[10:].copy())
        rates.append(uvms.GetOutputPort("acceleration").Eval(context).copy())
    assert np.linalg.norm(uvms.GetOutputPort("force").Eval(context)) > 1.0
    expected = (np.array(zeta[2:]) - np.array(zeta[:-2])) / (2.0 * step)
    np.testing.assert_allclose(rates[1:-1], expected, atol=1e-5 * np.max(np.abs(expected)))


def test_left_alone_it_floats_up_slowly_and_arm_and_water_bring_it_to_rest():
    """It is trimmed a little light; nothing blows up although added mass exceeds the dry mass."""
    uvms = make()
    simulator = simulator_of(uvms)
    set_state(uvms, simulator.get_mutable_context(), moving_state())
    simulator.AdvanceTo(10.0)
    state = uvms.GetOutputPort("state").Eval(simulator.get_context())
    assert np.all(np.isfinite(state))
    assert np.linalg.norm(state[10:16]) < 0.3


def test_a_surface_of_ones_own_pushes_by_its_law():
    sphere = Sphere()
    uvms = make(sphere)
    context = uvms.CreateDefaultContext()
    set_state(uvms, context, np.concatenate([[-1.6], np.zeros(19)]))
    plant = uvms.GetSubsystemByName("plant")
    tip = uvms.GetSubsystemByName("surface")._tip
    chi, _ = pose_and_jacobian(plant, uvms.GetSubsystemContext(plant, context), tip)
    force = uvms.GetOutputPort("force").Eval(context)
    assert np.linalg.norm(force) > 10.0
    np.testing.assert_array_equal(force, sphere.force(chi, np.zeros(6)))
    with pytest.raises(InvalidParameter, match=r"^surface\.stiffness = -1\.0: must be positive$"):
        make(Sphere(stiffness=-1.0))


def test_a_clone_of_a_context_goes_on_from_its_own_state():
    """Geometry that is known already is not computed again as the water begins to move."""
    uvms, current = make(UnilateralPlane()), np.array([0.3, -0.2, 0.1])
    accelerations = []
    for known in (True, False):
        context = uvms.CreateDefaultContext()
        uvms.GetInputPort("current").FixValue(context, np.zeros(3))
        set_state(uvms, context, moving_state())
        clone = context
        if known:
            uvms.GetOutputPort("acceleration").Eval(context)
            clone = context.Clone()
            set_state(uvms, context, 0.5 * moving_state())
            uvms.GetOutputPort("acceleration").Eval(context)
        uvms.GetInputPort("current").FixValue(clone, current)
        accelerations.append(uvms.GetOutputPort("acceleration").Eval(clone).copy())
    np.testing.assert_array_equal(*accelerations)


def test_two_threads_with_a_context_each_do_not_disturb_each_other():
    """A plant is const, as Drake's systems are: its data are in the Context."""
    uvms = make(UnilateralPlane())
    plant, coordinates = parts_of(uvms)

    def accelerations(state: np.ndarray, count: int) -> np.ndarray:
        context = uvms.CreateDefaultContext()
        found = []
        for i in range(count):
            context.SetTime(float(i))
            plant.SetPositionsAndVelocities(
                plant.GetMyMutableContextFromRoot(context), coordinates.to_drake(state))
            found.append(uvms.GetOutputPort("acceleration").Eval(context))
        return np.array(found)

    states = [moving_state(), 0.5 * moving_state()]
    expected = [accelerations(state, 1) for state in states]
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(2) as pool:
            found = list(pool.map(accelerations, states, [150, 150]))
    finally:
        sys.setswitchinterval(interval)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, np.broadcast_to(other, one.shape), atol=1e-12)
