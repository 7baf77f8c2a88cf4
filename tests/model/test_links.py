"""Tests of `uvms_drake.model.links`."""

import numpy as np
import pytest

from uvms_drake.model.frames.spatial import cross_motion, times
from uvms_drake.model.links import Links, read_links


@pytest.fixture(scope="module")
def links(uvms) -> Links:
    return read_links(uvms)


@pytest.fixture
def motion() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Velocities, accelerations and gravity of the links, three times."""
    rng = np.random.default_rng(1)
    return rng.normal(size=(3, 5, 6)), rng.normal(size=(3, 5, 6)), rng.normal(size=(3, 5, 3))


def test_welded_bodies_are_dragged_by_the_velocities_of_their_own_points(links, uvms):
    """The power that drag takes from a link is that of every point, its velocity from Drake."""
    plant, rng = uvms.plant, np.random.default_rng(2)
    context = plant.CreateDefaultContext()
    plant.SetVelocities(context, rng.normal(size=plant.num_velocities()))
    frames = [uvms.vehicle.body_frame(),
              *(joint.child_body().body_frame() for joint in uvms.joints[:-1]), uvms.tip]
    W = plant.world_frame()
    V = np.array([np.concatenate([velocity.translational(), velocity.rotational()]) for velocity in
                  (frame.CalcSpatialVelocity(context, W, frame) for frame in frames)])
    zero, still = np.zeros((5, 6)), np.zeros((5, 3))
    power = np.sum(V * links.links_force(V, zero, still))  # V ×* I V does not have any.
    expected = 0.0
    for name, body in uvms.hydrodynamics.bodies.items():
        B = plant.GetBodyByName(name).body_frame()
        velocity = B.CalcSpatialVelocity(context, W, B)
        for drag in body.drag:
            v = np.concatenate([
                velocity.Shift(np.asarray(drag.point)).translational(), velocity.rotational()])
            expected += np.sum((drag.linear + drag.quadratic * np.abs(v)) * v**2)
    assert power == pytest.approx(expected, rel=1e-10)


def test_the_gradients_are_those_of_differences(links, motion, derivative):
    """N: A changes by δV × V. K: gravity turns against the link."""
    V, A, g = motion
    N, K = links.force_gradients(V, g)
    rng = np.random.default_rng(3)
    for direction in rng.normal(size=(5, 6)):
        by_velocity = derivative(lambda s, d=direction: links.links_force(
            V + s * d, A + s * cross_motion(np.broadcast_to(d, V.shape), V), g), 1e-5)
        np.testing.assert_allclose(times(N, direction), by_velocity, rtol=1e-6, atol=1e-6)

        def turned(s, d=direction):
            return links.links_force(V, A, g @ _turn(s * d[3:]))  # Rᵀ g

        np.testing.assert_allclose(times(K, direction), derivative(turned), rtol=1e-6, atol=1e-6)


def _turn(vector: np.ndarray) -> np.ndarray:
    """Returns the rotation by the angle ‖vector‖ about it, by the series of exp S."""
    S = np.array([[0.0, -vector[2], vector[1]], [vector[2], 0.0, -vector[0]],
                  [-vector[1], vector[0], 0.0]])
    return np.eye(3) + S + S @ S / 2.0 + S @ S @ S / 6.0 + S @ S @ S @ S / 24.0
