"""Tests of `uvms_drake.control.contact.slope`: the fit, its bound, and what is forgotten."""

import numpy as np
import pytest

from uvms_drake.control.contact.slope import (
    NOTHING,
    Line,
    excess,
    slope,
    slope_error,
    surface_depth,
    with_reading,
    without_contact,
)

MOST, NOISE, MEMORY = 2000.0, 0.5, 10.0


def read(depths, forces, *, line=NOTHING, error=NOISE):
    """The lines after each reading of a contact."""
    lines = []
    for depth, force, each in zip(depths, forces, np.broadcast_to(error, len(depths)), strict=True):
        line = with_reading(line, depth, force, MOST, NOISE, MEMORY, each)
        lines.append(line)
    return lines


def test_the_moments_are_those_of_a_weighted_least_squares_fit():
    rng = np.random.default_rng(0)
    depths = np.cumsum(rng.uniform(0.0, 2e-3, 12))
    error = NOISE * rng.uniform(1.0, 3.0, 12)
    forces = 700.0 * depths + rng.uniform(-1.0, 1.0, 12) * NOISE
    lines = read(depths, forces, error=error)
    # The weights, typed a second time.
    g = np.array([1.0])
    for i in range(1, 12):
        u = abs(depths[i] - depths[i - 1]) * slope(lines[i - 1], MOST, NOISE) / MEMORY
        g = np.append(g * np.exp(-u), 1.0 - np.exp(-u))
    assert np.sum(g) == pytest.approx(1.0)
    w = g * (NOISE / error) ** 2
    fit, at_zero = np.polyfit(depths, forces, 1, w=np.sqrt(w))
    last = lines[-1]
    assert last.rise / last.spread == pytest.approx(fit)
    assert last.force - fit * last.depth == pytest.approx(at_zero)
    assert last.weight == pytest.approx(np.sum(w))
    mean = np.sum(w * depths) / np.sum(w)
    assert last.spread == pytest.approx(np.sum(w * (depths - mean) ** 2))


@pytest.mark.parametrize("kappa", [100.0, 700.0, 1999.0])
@pytest.mark.parametrize("way", [1e-4, 5e-3, 5e-2])
def test_it_is_never_below_the_slope_of_a_straight_wall(kappa, way):
    """Whatever noise within its bound, also the worst; and no such wall is taken for another."""
    rng = np.random.default_rng(1)
    for trial in range(20):
        depths = way * np.cumsum(rng.normal(0.2, 1.0, 60)) / 60.0
        error = NOISE * rng.uniform(1.0, 4.0, 60)
        noise = error * (rng.choice([-1.0, 1.0], 60) if trial % 2 else
                         -np.sign(depths - np.median(depths)))
        forces = kappa * depths + 20.0 + noise
        line = NOTHING
        for depth, force, each in zip(depths, forces, error, strict=True):
            assert abs(excess(line, depth, force, MOST, NOISE, each)) < 1e-9
            line = with_reading(line, depth, force, MOST, NOISE, MEMORY, each)
            assert kappa * (1 - 1e-9) <= slope(line, MOST, NOISE) <= MOST


def test_the_error_of_the_slope_is_attained():
    """By two readings as far apart as they weigh the same, each off by ν, against each other."""
    way = np.log(2.0) * MEMORY / MOST  # e^(−u) = 1/2 while κ̂ = κ₊.
    last = read([0.0, way], [NOISE, 1000.0 * way - NOISE])[-1]
    assert last.rise / last.spread == pytest.approx(1000.0 - slope_error(last, NOISE))


def test_it_finds_the_slope():
    depths = np.linspace(0.0, 0.1, 400)
    noise = np.random.default_rng(2).uniform(-NOISE, NOISE, 400)
    last = read(depths, 200.0 * (depths + 0.01) + noise)[-1]
    assert 200.0 <= slope(last, MOST, NOISE) < 250.0
    assert surface_depth(last, MOST, NOISE) == pytest.approx(-0.01, abs=0.02)


def test_nothing_known_is_the_stiffest_wall():
    assert slope(NOTHING, MOST, NOISE) == MOST
    assert np.isnan(surface_depth(NOTHING, MOST, NOISE))
    once = read([0.3], [10.0])[-1]
    assert slope(once, MOST, NOISE) == MOST
    assert surface_depth(once, MOST, NOISE) == pytest.approx(0.3 - 10.0 / MOST)


def test_a_tip_at_rest_neither_learns_nor_forgets():
    depths = np.linspace(0.0, 0.02, 50)
    before = read(depths, 500.0 * depths + 5.0)[-1]
    noise = np.random.default_rng(3).uniform(-NOISE, NOISE, 1000)
    after = read(np.full(1000, 0.02), 15.0 + noise, line=before)[-1]
    np.testing.assert_array_equal(after, before)


def test_noise_of_the_depth_makes_no_wall_look_soft():
    """A tip at rest on the stiffest wall, its position measured with an error of 0.2 mm."""
    rng, wrong = np.random.default_rng(4), 2e-4
    declared = NOISE + MOST * wrong
    line = NOTHING
    for _ in range(2000):
        line = with_reading(line, 0.01 + rng.uniform(-wrong, wrong),
                            MOST * 0.01 + rng.uniform(-NOISE, NOISE), MOST, declared, MEMORY,
                            declared)
        assert slope(line, MOST, declared) == pytest.approx(MOST)


def test_hard_below_soft_is_noticed_within_a_few_noises():
    depths = np.linspace(0.0, 0.1, 200)
    soft = read(depths, 100.0 * depths + 5.0)[-1]
    assert slope(soft, MOST, NOISE) < 300.0
    steps = np.linspace(0.0, 0.005, 50)
    hard = read(0.1 + steps, 15.0 + MOST * steps, line=soft)
    assert slope(hard[np.searchsorted(MOST * steps, 8.0 * NOISE)], MOST, NOISE) > 0.9 * MOST


def test_a_wall_that_is_gone_is_forgotten_and_one_ahead_is_not():
    depths = np.linspace(0.0, 0.02, 50)
    line = read(depths, 500.0 * depths)[-1]
    for depth, forgotten in ((-0.05, False), (0.0, False), (0.02, True)):
        after = without_contact(line, depth, 0.2, MOST, NOISE, NOISE)
        assert (after.weight == 0.0) == forgotten
        assert slope(after, MOST, NOISE) == (MOST if forgotten else slope(line, MOST, NOISE))


def test_walls_can_be_stacked():
    rng = np.random.default_rng(5)
    depths, forces = np.cumsum(rng.uniform(0, 1e-3, (30, 4)), axis=0), rng.uniform(0, 20, (30, 4))
    together = Line(*np.zeros((6, 4)))
    for depth, force in zip(depths, forces, strict=True):
        together = with_reading(together, depth, force, MOST, NOISE, MEMORY, NOISE)
    alone = [read(depths[:, i], forces[:, i])[-1] for i in range(4)]
    np.testing.assert_allclose(together, np.transpose(alone), rtol=1e-12)


def test_a_slide_on_a_wall_that_runs_off_the_direction_looks_soft():
    """10 N on 700 N/m, at most 1000 N/m, a reading every 0.2 mm of a way at 3 degrees."""
    most, kappa, noise = 1000.0, 700.0, 4.2
    line = NOTHING
    for force in np.linspace(0.0, 10.0, 300):
        line = with_reading(line, force / kappa, force, most, noise, MEMORY, noise)
    assert slope(line, most, noise) == most
    learned = []
    for way in np.arange(0.0, 0.6, 2e-4):
        depth = 10.0 / kappa + way * np.tan(np.radians(3.0))
        line = with_reading(line, depth, 10.0, most, noise, MEMORY, noise)
        learned.append(float(slope(line, most, noise)))
    assert learned[1500] == pytest.approx(782.0, abs=5.0)
    assert learned[2000] < kappa
