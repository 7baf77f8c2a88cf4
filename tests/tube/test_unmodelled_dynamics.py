"""Tests of `tube.unmodelled_dynamics`: against Drake's plant, with the error and without."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from support.true_model import model_with_error

from uvms_drake.model.frames.spatial import times
from uvms_drake.model.surface.contact_laws import dissipation_factor
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.plant.joint_friction import JointFriction
from uvms_drake.plant.model_error import AxisFactors, ModelError
from uvms_drake.plant.payload import Payload
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state
from uvms_drake.plant.waves import Wave, water_motion
from uvms_drake.tube.estimates import LEAST_SHARE
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.joint_search import second_over_joints, supremum_over_joints
from uvms_drake.tube.unmodelled_dynamics import (
    ForceChange,
    MotionSet,
    UnmodelledTerm,
    by_forces,
    by_robot,
    by_water,
    commanded_rate,
    family,
    sizes,
    sizes_of,
    tip_acceleration,
)

GIRONA = "girona500_arm5e"
FACTOR = 1.1
"""Declared safety factor of what is searched for."""
RATE = np.repeat([0.7, 3.0], [6, 4])
WEIGHTS = np.repeat([0.1, 0.2, 1.0], [3, 3, 4])
DECLARED = ConstraintSet(
    q_lower=np.array([-0.25, 0.7, 0.2, -0.4]), q_upper=np.array([0.25, 1.25, 0.72, 0.4]),
    roll=0.15, pitch=0.15, tip_pitch=0.4, nu1=0.15, nu2=0.1, qdot=0.3)
WAVE = Wave(amplitude=0.4, period=6.0, depth=2.5)


def rate_at(at):
    """Returns the bounds of |ζ̇_c|, the same at every motion."""
    return np.broadcast_to(RATE, at.zeta.shape)


def robot(error: ModelError):
    def load(known) -> UnmodelledTerm:
        return by_robot(family(known, []), family(
            model_with_error(GIRONA, UnilateralPlane(), error), []), rate_at)

    return load


def by_axis(*errors: ModelError):
    """Returns the term of errors at their sizes, each of which is an error of its own."""
    def load(known) -> UnmodelledTerm:
        ends = [model_with_error(GIRONA, UnilateralPlane(), error) for error in errors]
        return by_robot(family(known, []), family(known, ends), rate_at)

    return load


def axes(**factors) -> ModelError:
    return ModelError(vehicle=AxisFactors(**{name: np.array(f) for name, f in factors.items()}))


class Motion(NamedTuple):
    """A motion in a current."""

    q: tuple
    attitude: tuple
    zeta: tuple
    heading: float


class Case(NamedTuple):
    """An error, as the plant has it and as a load."""

    load: object
    error: ModelError | None = None
    water: object = None
    """Of heading and phase: v_c and v̇_c."""
    errors: int = 0
    """Number of errors by axis."""


def current(heading, phase):
    return 0.25 * np.array([np.cos(heading), np.sin(heading), 0.0]), np.zeros(3)


def wave(heading, phase):
    return water_motion(np.zeros(3), [Wave(**vars(WAVE) | {
        "direction": heading, "phase": phase})], 0.0)


CASES = {
    "mass": Case(robot(ModelError(mass=1.2)), ModelError(mass=1.2)),
    "added mass": Case(robot(ModelError(added_mass=0.8)), ModelError(added_mass=0.8)),
    "trim": Case(robot(ModelError(buoyancy=0.98)), ModelError(buoyancy=0.98)),
    "payload": Case(robot(ModelError(payload=Payload(mass=0.5))),
                    ModelError(payload=Payload(mass=0.5))),
    "by axis": Case(
        by_axis(axes(added_mass=[1.3, 1, 1, 1, 1, 1]), axes(added_mass=[1, 1, 1, 1.4, 1, 1]),
                axes(quadratic_drag=[1, 2, 1, 1, 1, 1])),
        axes(added_mass=[1.3, 1, 1, 1.4, 1, 1], quadratic_drag=[1, 2, 1, 1, 1, 1]), errors=3),
    "friction": Case(lambda known: by_forces(
        family(known, []), np.repeat([0.0, 0.5], [6, 4])), ModelError(
            joint_friction=JointFriction(coulomb=np.array([0.5]), creep=1e-6))),
    "current": Case(lambda known: by_water(family(known, []), (0.25, 0.0)), water=current),
    "wave": Case(lambda known: by_water(
        family(known, []), (0.0, 0.0), (WAVE.speed, WAVE.frequency)), water=wave)}


def plant_acceleration(case: Case, known, at, i: int, rate: np.ndarray) -> np.ndarray:
    """Returns ζ̇ (6+n,) of the plant where the law asks for `rate` (6+n,), at motion i."""
    plant = make_uvms_plant(GIRONA, surface=None, error=case.error,
                            disturbance=ConstantDisturbance(bound=0.0))
    context = plant.CreateDefaultContext()
    set_state(plant, context, np.concatenate([at.config[i], at.zeta[i]]))
    tau = known.inverse_dynamics(at.kinematics.at(i), at.zeta[i], rate, np.zeros(6))
    plant.GetInputPort("tau").FixValue(context, tau)
    if case.water is not None:
        for name, value in zip(("current", "current_acceleration"),
                               case.water(at.heading[i], at.phase[i]), strict=True):
            plant.GetInputPort(name).FixValue(context, value)
    return plant.GetOutputPort("acceleration").Eval(context)


def some(count: int, model, seed: int, near: np.ndarray | None = None, errors: int = 0):
    """Returns random motions, many of them on faces and edges of the set, and their points.

    Some of their coordinates are those of a point, if it is given.
    """
    motions = MotionSet(model, DECLARED, [-1.0] * errors)
    rng, (lower, upper) = np.random.default_rng(seed), motions.box
    unit = np.clip(rng.uniform(-0.3, 1.3, (count, len(lower))), 0.0, 1.0)
    points = lower + unit * (upper - lower)
    if near is not None:
        points = np.where(rng.uniform(size=points.shape) < 0.7, near, points)
    return motions.at(points), points


@pytest.mark.parametrize("name", CASES)
def test_the_plant_does_what_is_said(name, model):
    """Its d is c + As to rounding, whatever s is: ζ̇_c over its bound, or the sign of friction."""
    case = CASES[name]
    at, _ = some(2, model, 1, errors=case.errors)
    at = replace(at, errors=np.ones_like(at.errors))
    c, A = case.load(model)(at)
    for i, share in enumerate(np.random.default_rng(2).uniform(-1.0, 1.0, (2, 10))):
        s = -np.sign(at.zeta[i]) if name == "friction" else share[: A.shape[-1]]
        rate = RATE * share
        d = plant_acceleration(case, model, at, i, rate) - rate
        np.testing.assert_allclose(d, c[i] + A[i] @ s, atol=1e-7)


ALIKE = ("added mass", "trim", "payload", "current")
"""Cases with the same function as another: of the robot as mass, of the water as a wave."""


@pytest.mark.slow
@pytest.mark.parametrize("name", [
    pytest.param(name, marks=pytest.mark.long) if name in ALIKE else name for name in CASES])
def test_no_motion_is_beyond_the_claim_and_some_come_close(name, model):
    load, errors = CASES[name].load(model), CASES[name].errors
    motions = MotionSet(model, DECLARED, [-1.0] * errors)
    function = sizes_of([load], motions, WEIGHTS)
    claim, near = FACTOR * supremum_over_joints(function, *motions.box), None
    again = second_over_joints(function, *motions.box)
    assert np.all(again <= claim)
    assert again[-1] > LEAST_SHARE * claim[-1]
    for seed in range(3, 6):  # Each about the worst of the last one.
        at, points = some(4000, model, seed, near, errors)
        found = sizes(load(at), WEIGHTS)
        assert np.all(found <= claim)
        near = points[np.argmax(found[:, -1])]
    assert np.max(found[:, -1]) > 0.9 * claim[-1] / FACTOR


STEEP = Motion(
    q=(-0.25, 1.25, 0.72, 0.139), attitude=(0.15, 0.15, 0.0), heading=-0.449,
    zeta=(-0.081, 0.042, -0.119, 0.0075, 0.0988, 0.0132, 0.014, 0.283, 0.098, 0.0005))
"""A motion that was found outside of a claim; its tip pitch is 0.58 rad."""


@pytest.mark.slow
def test_the_motion_that_refuted_a_claim_is_in_a_set_only_with_its_tip_pitch(model):
    """In Drake's plant, in a current of 0.1 m/s, with the weights of that claim."""
    weights = np.array([0.069, 0.11, 0.025, 0.027, 0.068, 0.1, 1.0, 0.35, 0.41, 0.01])
    point = np.array([[*STEEP.attitude, *STEEP.q, *np.array(STEEP.zeta) / np.repeat(
        [DECLARED.nu1, DECLARED.nu2, DECLARED.qdot], [3, 3, 4]), STEEP.heading, 0.0]])
    narrow, wide = (MotionSet(model, replace(DECLARED, tip_pitch=each)) for each in (0.4, 0.6))
    case = Case(None, water=lambda heading, phase: (
        0.1 * np.array([np.cos(heading), np.sin(heading), 0.0]), np.zeros(3)))
    rate, off = np.zeros(10), []
    for motions in (narrow, wide):
        at = motions.at(point)
        off.append(plant_acceleration(case, model, at, 0, rate))
        # Neither set has a claim below what the plant does in one of its motions.
        function = sizes_of([by_water(family(model, []), (0.1, 0.0))], motions, weights)
        claim = FACTOR * supremum_over_joints(function, *motions.box)
        assert np.all(np.abs(off[-1]) <= claim[:-1])
        assert np.linalg.norm(off[-1] / weights) <= claim[-1]
        assert np.abs(at.kinematics.chi[0, 4]) <= motions.declared.tip_pitch + 1e-9
    np.testing.assert_allclose(at.config[0, 6:], STEEP.q)
    np.testing.assert_allclose(at.zeta[0], STEEP.zeta, atol=1e-12)
    assert at.kinematics.chi[0, 4] == pytest.approx(0.58, abs=0.01)
    assert np.linalg.norm(off[1] / weights) == pytest.approx(1.045 * 0.91613, rel=0.01)


def test_no_point_about_the_tip_accelerates_by_more_than_is_said(model):
    """Second differences along motions, of points 0.2 m from the tip; the tip comes close."""
    motions = MotionSet(model, DECLARED)
    (lower, upper), rng, reach, h = motions.box, np.random.default_rng(4), 0.2, 1e-3
    at = motions.at(rng.uniform(lower, upper, (200, len(lower))))
    bounds = [tip_acceleration(model, at, np.broadcast_to(RATE, at.zeta.shape), size)
              for size in (0.0, reach)]
    zeta_dot = RATE * rng.choice([-1.0, 1.0], at.zeta.shape)
    off = rng.normal(size=(200, 3))
    off *= reach / np.linalg.norm(off, axis=1, keepdims=True)

    def moved(time):
        """Returns positions of the tip and of the point, after a step of Runge and Kutta."""
        config = at.config
        k1 = configuration_rate(config, at.zeta)
        k2 = configuration_rate(config + 0.5 * time * k1, at.zeta + 0.5 * time * zeta_dot)
        k3 = configuration_rate(config + 0.5 * time * k2, at.zeta + 0.5 * time * zeta_dot)
        k4 = configuration_rate(config + time * k3, at.zeta + time * zeta_dot)
        there = model.kinematics(config + time / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))
        tip = there.chi[:, :3]
        return tip, tip + times(there.A_E[:, :3, :3], off)

    for bound, before, now, after in zip(bounds, moved(-h), moved(0.0), moved(h), strict=True):
        found = np.linalg.norm(before - 2.0 * now + after, axis=1) / h**2
        assert np.all(found <= bound + 1e-5)
    assert np.max(np.linalg.norm(moved(-h)[0] - 2.0 * moved(0.0)[0] + moved(h)[0], axis=1)
                  / h**2 / bounds[0]) > 0.9


def test_a_force_that_its_reading_misses_accelerates_no_more_than_the_rate_says(model):
    """Random changes along n of the cone and across; the worst of each comes close."""
    at, _ = some(20, model, 6)
    missed, rng = ForceChange(12.5, 5.2, 0.25), np.random.default_rng(7)
    limits = np.full(10, 2.0), np.full(10, 3.0)
    allowed = (commanded_rate(model, *limits, missed=missed)(at)
               - commanded_rate(model, *limits)(at))
    off = missed.tool_angle * np.sqrt(rng.uniform(size=3000))
    about = rng.uniform(0.0, 2.0 * np.pi, 3000)
    n = np.stack([np.cos(off), np.sin(off) * np.cos(about), np.sin(off) * np.sin(about)], axis=1)
    across = rng.normal(size=(3000, 3))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    inverse = np.linalg.inv(model.mass_matrix(at.kinematics))
    J_E = at.kinematics.J_links[:, -1, :3]
    for change in (missed.normal * n, missed.tangential * across):
        change = np.concatenate([change, -change])
        found = np.abs(inverse @ J_E.swapaxes(1, 2) @ change.T)
        assert np.all(np.max(found, axis=2) <= allowed + 1e-12)
    both = np.concatenate([missed.normal * n + sign * missed.tangential * across
                           for sign in (-1.0, 1.0)])
    found = np.max(np.abs(inverse @ J_E.swapaxes(1, 2) @ both.T), axis=2)
    assert np.all(found <= allowed + 1e-12)
    assert np.all(found > 0.8 * allowed)


def test_the_largest_norm_is_climbed_for_as_well_as_all_corners_say():
    rng = np.random.default_rng(4)
    c, A = rng.normal(size=(200, 5)), rng.normal(size=(200, 5, 6))
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 6)).reshape(6, -1)
    every = c[..., None] + A @ corners
    found = sizes((c, A), 1.0)
    np.testing.assert_allclose(found[:, :-1], np.max(np.abs(every), axis=2))
    best = np.max(np.linalg.norm(every, axis=1), axis=1)
    assert np.all(found[:, -1] <= best + 1e-12)
    assert np.min(found[:, -1] / best) > 0.85
    assert np.mean(found[:, -1] > 0.999 * best) > 0.8


def test_a_known_surface_exerts_more_in_motion_than_its_largest_static_force(model):
    """Of a plane that damps, at the depth of that force: the rate allows for all of it."""
    at, _ = some(20, model, 6)
    limits, a, most = (np.full(10, 2.0), np.full(10, 1e3)), 2.5, 45.0
    allowed = (commanded_rate(model, *limits, force=most, damping=a)(at)
               - commanded_rate(model, *limits)(at))
    J_E, size = at.kinematics.J_links[:, -1, :3], 0.0
    inverse = np.linalg.inv(model.mass_matrix(at.kinematics))
    for normal in np.random.default_rng(3).normal(size=(300, 3)):
        n = normal / np.linalg.norm(normal)
        advance = times(J_E, at.zeta) @ n
        force = most * dissipation_factor(a * advance)[:, None] * n
        found = np.abs(times(inverse, times(J_E.swapaxes(1, 2), force)))
        assert np.all(found <= allowed + 1e-9)
        size = np.maximum(size, found / allowed)
    assert np.max(size) > 0.9
    still = commanded_rate(model, *limits, force=most)(at) - commanded_rate(model, *limits)(at)
    assert np.max(allowed / still) > 1.2
