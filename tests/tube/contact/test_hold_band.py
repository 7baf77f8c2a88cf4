"""The force band of a hold, against tips, walls and frictions drawn at random."""

from dataclasses import replace

import numpy as np
import pytest

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.limits.radii import HoldRadii
from uvms_drake.model.surface.unknown_contact import HoldForces, UnknownContact
from uvms_drake.tube.ultimate_bounds import error_along, hold_band

CONTACT = UnknownContact(angle=0.12, stiffness=900.0, dissipation=1.1, friction=0.45, period=0.012,
                        force_rate=30.0, force_ripple=1.5,
                        hold=HoldForces(force_rate=6.0, force_ripple=0.05))
OFF = HoldRadii(time=1.0, depth=5e-4, position=7e-4, advance=0.02, standing=2e-3, reading=1.3,
                age=0.03, since=0.012)
FORCE = 17.0


def largest_error(contact: UnknownContact, count: int, seed: int, off: HoldRadii) -> float:
    """Returns the largest error of n·F of random holds that keep every bound of the class.

    The wall's normal and the force across n are drawn at reading and now, all else is at an end.
    """
    rng = np.random.default_rng(seed)
    theta, mu, alpha = contact.angle, contact.friction, np.tan(contact.angle)
    sign = rng.choice([-1.0, 1.0], (6, count))
    E_t = off.position * alpha
    # The tip: its error at the reading, its advance since, and that of the reading's forces.
    x = sign[0] * off.depth
    since = np.minimum(off.depth - x + 2.0 * E_t, off.advance * off.since)
    advance = since + off.advance * off.age
    estimate = contact.stiffness * rng.choice([0.02, 1.0], count)
    read = FORCE + estimate * (x + sign[1] * E_t + off.standing * off.since)
    read = read + off.reading  # The force that is really there, in the mean.
    # Normals and frictions of a unit normal force, at the reading and now.
    def along(beta: np.ndarray, u: np.ndarray, p: np.ndarray) -> np.ndarray:
        return 1.0 / np.cos(beta) - np.tan(beta) * np.sum(u * p, axis=0)

    def drawn() -> tuple[np.ndarray, np.ndarray]:
        beta = theta * rng.choice([1.0, 0.5], count)
        turn = rng.choice([0.0, np.pi, 0.5], count)
        return beta, np.array([np.cos(turn), np.sin(turn)])

    (beta, u), (beta_now, u_now) = drawn(), drawn()
    slip = np.where(rng.uniform(size=count) < 0.7, np.pi, rng.uniform(0.0, 2.0 * np.pi, count))
    f = mu * np.array([np.cos(slip) * np.cos(beta_now), np.sin(slip)])
    p_now = np.array([np.sin(beta_now) + f[0], f[1]])  # About u_now.
    p_now = np.array([u_now[0] * p_now[0] - u_now[1] * p_now[1],
                      u_now[1] * p_now[0] + u_now[0] * p_now[1]])
    damped = contact.dissipation * off.advance
    before, now = 1.0 - sign[2] * damped, 1.0 + sign[2] * damped
    # Forces across n change by no more than their rate; p is over the normal force of its instant.
    change = (contact.hold_forces.force_rate * (off.age + off.since)
              + 2.0 * contact.hold_forces.force_ripple)
    static = read / (before * along(beta, u, p_now))
    for _ in range(30):
        ratio = now * (static + contact.stiffness * advance) / (before * static)
        p = ratio * p_now + change / (before * static) * rng.choice([-1.0, 0.0, 1.0]) * u
        cone = np.array([np.sum(p * u, axis=0) - np.sin(beta), u[0] * p[1] - u[1] * p[0]])
        inside = np.hypot(cone[0] / np.cos(beta), cone[1]) <= mu
        static = read / (before * along(beta, u, p))
    force = now * (static + contact.stiffness * advance) * along(beta_now, u_now, p_now)
    return float(np.max((force - FORCE)[inside]))


@pytest.mark.parametrize("contact", [CONTACT, replace(CONTACT, angle=0.05, friction=0.3),
                                     replace(CONTACT, angle=0.17, friction=0.4)])
@pytest.mark.parametrize(("since", "nearly"), [(0.012, 0.85), (0.4, 0.7)])
def test_no_hold_of_the_class_is_off_by_more_than_the_band_and_one_nearly_is(
        contact, since, nearly):
    """Of a target by the last reading, and by one that is as old as a mean reading."""
    off = replace(OFF, since=since)
    band = hold_band(contact, FORCE, off)
    worst = largest_error(contact, 200_000, 1, off)
    assert nearly * band < worst <= band


def test_without_friction_damping_and_angle_the_band_is_reading_and_stiffness():
    plain = replace(CONTACT, angle=0.0, dissipation=0.0, friction=0.0, hold=None)
    since = OFF.advance * OFF.since
    moved = max(0.0, min(2.0 * OFF.depth, since) - OFF.depth) + OFF.advance * OFF.age
    expected = 1.3 + 900.0 * (OFF.depth + OFF.standing * OFF.since + moved)
    assert hold_band(plain, FORCE, OFF) == pytest.approx(expected, rel=1e-12)
    short = hold_band(plain, FORCE, OFF, 1e-3)
    assert short - expected == pytest.approx(0.9, rel=1e-9)


def test_a_reading_that_takes_all_of_the_advance_counts_it():
    """With κ̂ near zero the tip may come from −E to E unnoticed, if it is fast enough."""
    plain = replace(CONTACT, angle=0.0, dissipation=0.0, friction=0.0, hold=None)
    fast = replace(OFF, standing=0.0, age=0.0, advance=0.5)
    assert hold_band(plain, FORCE, fast) == pytest.approx(1.3 + 900.0 * 2.0 * OFF.depth)


def test_friction_that_is_slow_makes_the_band_smaller_and_never_larger():
    still = replace(CONTACT, hold=HoldForces(0.0, 0.0))
    fast = replace(CONTACT, force_rate=1e4, force_ripple=1e3, hold=None)
    assert hold_band(still, FORCE, OFF) < hold_band(CONTACT, FORCE, OFF) < hold_band(
        fast, FORCE, OFF)


def test_an_error_along_n_is_the_largest_over_the_cone():
    rng = np.random.default_rng(0)
    for bound, angle in (([1.5, 1.5, 1.5], 0.25), ([2.0, 0.1, 0.2], 0.4), ([0.3, 1.0, 2.0], 0.2)):
        off, about = angle * np.sqrt(rng.uniform(size=40000)), rng.uniform(0.0, 6.3, 40000)
        n = np.stack([np.cos(off), np.sin(off) * np.cos(about), np.sin(off) * np.sin(about)])
        found = np.max(np.array(bound) @ np.abs(n))
        assert 0.99 * error_along(np.array(bound), angle) < found <= error_along(
            np.array(bound), angle) * (1.0 + 1e-12)


def test_bounds_in_a_hold_above_those_of_any_motion_are_refused():
    with pytest.raises(InvalidParameter, match=r"hold\.force_rate"):
        replace(CONTACT, hold=HoldForces(force_rate=50.0)).checked()
