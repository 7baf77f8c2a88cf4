"""Tests of `uvms_drake.control.limits.settings` and `radii`."""

from dataclasses import replace

import numpy as np
import pytest

import uvms_drake as uv
from uvms_drake.model.surface.law import check_surface

LIMITS = uv.limits.Limits(nu1=0.25, nu2=0.2, qdot=0.3, roll=0.33, pitch=0.31, tip_pitch=0.8,
                u=np.array([0.4, 0.3, 0.3, 0.4, 0.4, 0.4, 6.0, 8.0]),
                tau=np.array([90.0, 80.0, 70.0, 60.0, 50.0, 40.0, 5.0, 4.0]))
TUBE = uv.limits.TubeRadii(e=0.19, position=0.18, orientation=0.01, joints=0.012, z=0.17, nu1=0.04,
                 nu2=0.03, qdot=0.05, depth=0.15, depth_speed=0.11, roll=0.06, pitch=0.02,
                 u=np.array([0.1, 0.1, 0.1, 0.2, 0.2, 0.2, 0.5, 0.7]),
                 tau=np.array([9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 0.5, 0.4]))
"""All different: each limit has one radius of its own."""
Q_LOWER, Q_UPPER = np.array([-0.5, -1.3]), np.array([1.4, 0.7])
PLANE = check_surface(uv.UnilateralPlane(
    point=np.array([0.3, -0.2, 1.1]), normal=np.array([-0.6, 0.0, 0.8]), stiffness=830.0))


def less(limits, tube, q_lower=Q_LOWER, q_upper=Q_UPPER) -> dict[str, uv.Limit]:
    """Returns the tightened limits."""
    return uv.limits.tighten(uv.limits.make_limits(limits, q_lower, q_upper, PLANE), tube)


def margins(limits, tube) -> list[tuple[str, float, float]]:
    """Returns label, tightening and available margin of every limit."""
    tube = uv.limits.resolved_radii(tube)
    return [available for limit in uv.limits.make_limits(limits, Q_LOWER, Q_UPPER, PLANE).values()
            for available in limit.margins(tube)]


BLOCKS = {"position": "e", "orientation": "e", "joints": "e", "nu1": "z", "nu2": "z", "qdot": "z"}


@pytest.mark.parametrize("blocks", [True, False])
def test_every_limit_loses_the_radius_of_its_own_block_or_the_total(blocks):
    tube = TUBE if blocks else replace(TUBE, **dict.fromkeys(BLOCKS))
    resolved = uv.limits.resolved_radii(tube)
    radii = {block: getattr(TUBE, block if blocks else total) for block, total in BLOCKS.items()}
    assert {block: getattr(resolved, block) for block in BLOCKS} == radii
    remaining = less(LIMITS, tube)
    for name, radius in {"nu1": radii["nu1"], "nu2": radii["nu2"], "qdot": radii["qdot"],
                         "roll": 0.06, "pitch": 0.02, "tip_pitch": radii["orientation"],
                         "u": TUBE.u, "tau": TUBE.tau}.items():
        np.testing.assert_allclose(remaining[name].upper, getattr(LIMITS, name) - radius)
    np.testing.assert_allclose(remaining["q"].lower, Q_LOWER + radii["joints"])
    np.testing.assert_allclose(remaining["q"].upper, Q_UPPER - radii["joints"])


# Joints ------------------------------------------------------------------------------------------


def test_joint_limits_are_the_robots_or_the_narrower_ones_asked_for():
    lower, upper = uv.limits.joint_limits(LIMITS, Q_LOWER, Q_UPPER)
    np.testing.assert_array_equal(lower, Q_LOWER)
    np.testing.assert_array_equal(upper, Q_UPPER)
    asked = replace(LIMITS, q_lower=[-0.4, -1.3])
    lower, upper = uv.limits.joint_limits(asked, Q_LOWER, Q_UPPER)
    np.testing.assert_array_equal(lower, [-0.4, -1.3])
    np.testing.assert_array_equal(upper, Q_UPPER)
    lower, upper = uv.limits.joint_limits(replace(asked, q_upper=[0.1, 0.2]), Q_LOWER, Q_UPPER)
    np.testing.assert_array_equal(lower, [-0.4, -1.3])
    np.testing.assert_array_equal(upper, [0.1, 0.2])


@pytest.mark.parametrize(("radius", "limit"), [
    ("nu1", "nu1"), ("nu2", "nu2"), ("qdot", "qdot"), ("roll", "roll"), ("pitch", "pitch"),
    ("orientation", "tip_pitch")])
def test_a_tube_as_wide_as_a_limit_is_refused_and_a_little_less_is_not(radius, limit):
    available = getattr(LIMITS, limit)
    remaining = less(LIMITS, replace(TUBE, **{radius: 0.999 * available}))
    assert remaining[limit].upper[0] == pytest.approx(0.001 * available)
    with pytest.raises(uv.InvalidParameter) as caught:
        less(LIMITS, replace(TUBE, **{radius: available}))
    assert caught.value.key == f"limits.{limit}"
    assert caught.value.value == available
    assert f"larger than the tube's {available:.4g}" in str(caught.value)


@pytest.mark.parametrize(("limits", "tube", "key"), [
    ({"nu1": 0.04}, {}, "limits.nu1"), ({"qdot": np.inf}, {}, "limits.qdot"),
    ({"roll": 1.6}, {}, "limits.roll"), ({"nu1": np.nan}, {}, "limits.nu1"),
    ({"u": np.full(8, 0.15)}, {}, "limits.u[3]"), ({"u": np.ones(3)}, {}, "limits.u"),
    ({"u": np.array([1, 1, 1, 1, 1, 1, 1, -1.0])}, {}, "limits.u"),
    ({"tau": np.full(8, 8.5)}, {}, "limits.tau[0]"), ({"tau": np.ones(10)}, {}, "limits.tau"),
    ({"q_lower": [-0.6, 0.0]}, {}, "limits.q_lower"), ({"q_lower": [0.0]}, {}, "limits.q_lower"),
    ({"q_upper": [1.4, 0.71]}, {}, "limits.q_upper"),
    ({"q_lower": [0.3, 0.0], "q_upper": [0.2, 0.1]}, {}, "limits.q_lower"),
    ({"q_lower": [0.0, 0.0], "q_upper": [0.1, 0.024]}, {}, "limits.q2"),
    ({}, {"u": np.zeros(10)}, "tube.u"), ({}, {"tau": None}, "limits.tau"),
    ({}, {"tau": np.array([0, 0, 0, 0, 0, 0, 0, -0.1])}, "tube.tau"),
    ({}, {"position": -1e-9}, "tube.position"), ({}, {"orientation": np.inf}, "tube.orientation"),
    ({"tip_pitch": 1.5}, {"orientation": 1.0, "joints": 1.0}, "limits.q1")])
def test_what_leaves_nothing_or_means_nothing_is_named(limits, tube, key):
    with pytest.raises(uv.InvalidParameter) as caught:
        less(replace(LIMITS, **limits), replace(TUBE, **tube))
    assert caught.value.key == key


@pytest.mark.parametrize(("slides", "length"), [
    ([], []), ([False, True], ["q2"]), ([True, True], ["q1", "q2"])])
def test_what_is_of_a_joint_that_slides_is_in_metres(slides, length):
    limits = uv.limits.make_limits(LIMITS, Q_LOWER, Q_UPPER, PLANE, slides=slides)
    for joint in ("q1", "q2"):
        straight = joint in length
        end = ("m", "m/s²", "N") if straight else ("rad", "rad/s²", "N m")
        assert (limits["q"].unit_of(f"{joint}_min"), limits["u"].unit_of(f"u_{joint}"),
                limits["tau"].unit_of(f"tau_{joint}")) == end
        assert limits["q"].bars[int(joint[1]) - 1].endswith(f" {end[0]}")
    assert limits["qdot"].unit_of("qdot") == ("rad/s", "rad/s, m/s", "m/s")[len(length)]
    assert limits["u"].unit_of("u_sway") == "m/s²"
    assert limits["tau"].unit_of("tau_yaw") == "N m"
