"""Tests of `uvms_drake.tube.search.search_memo`, and of the searches that it holds."""


import numpy as np
import pytest

from uvms_drake.tube.laws.resolved_remainders import RemainderProblem
from uvms_drake.tube.search.ascent import first_order, supremum
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.joint_search import second_over_joints, supremum_over_joints
from uvms_drake.tube.search.search_memo import active_memo, memoising

LOWER, UPPER = np.array([-1.0, 0.0]), np.array([1.0, 2.0])


class Counted:
    """A function of two angles, with its number of points."""

    def __init__(self, scale: float = 1.0):
        self.points, self._scale = 0, scale

    def __call__(self, q: np.ndarray) -> np.ndarray:
        self.points += len(q)
        return self._scale * np.stack(
            [np.exp(-4.0 * np.sum((q - [0.3, 1.4]) ** 2, axis=1)), q[:, 0]], axis=1)


def test_a_held_search_looks_only_where_it_found_the_largest():
    plain = supremum_over_joints(Counted(), LOWER, UPPER)
    with memoising() as searches:
        np.testing.assert_array_equal(supremum_over_joints(Counted(), LOWER, UPPER), plain)
        searches.again()
        larger = Counted(3.0)
        np.testing.assert_allclose(supremum_over_joints(larger, LOWER, UPPER), 3.0 * plain)
        assert larger.points == 2, "the one of each component"
        one = Counted()
        second_over_joints(one, LOWER, UPPER)
        assert one.points == 1
    whole = Counted()
    assert active_memo() is None
    supremum_over_joints(whole, LOWER, UPPER)
    assert whole.points > 1000


def test_searches_are_found_again_in_their_order():
    other = Counted(2.0)
    with memoising() as searches:
        first = [supremum_over_joints(each, LOWER, UPPER) for each in (Counted(), other)]
        for _ in range(2):
            searches.again()
            for each, known in zip((Counted(), other), first, strict=True):
                np.testing.assert_allclose(
                    supremum_over_joints(each, LOWER, UPPER), known)
        new = Counted()
        supremum_over_joints(new, LOWER, UPPER)
        assert new.points > 1000, "the third of its kind"


def test_an_ascent_that_is_held_follows_the_errors(model, monkeypatch):
    """Rests of twice the errors: from the held motions nearly what a search finds anew."""
    monkeypatch.setattr("uvms_drake.tube.search.ascent.LEADERS", 2)
    monkeypatch.setattr("uvms_drake.tube.search.ascent.STEPS", 1)
    declared = ConstraintSet(
        q_lower=np.array([-0.4, 0.6, -0.1, -0.8]), q_upper=np.array([0.4, 1.3, 0.72, 0.8]),
        roll=0.15, pitch=0.15, tip_pitch=0.4, nu1=0.25, nu2=0.2, qdot=0.3, force_max=32.0)
    limits, eye, wanted = np.repeat([0.4, 8.0], [6, 4]), np.eye(20), [5, 6]

    def problem(size: float) -> RemainderProblem:
        return RemainderProblem(model, declared, [(eye[:, :3], 0.001 * size), (eye[:, 10:], 0.003)],
                           limits, 20.0, 5.0)

    def values(at: RemainderProblem) -> np.ndarray:
        out = np.zeros((len(x), len(at.channels)))
        out[:, wanted] = first_order(at, x)[:, wanted]
        return out

    small, large = problem(1.0), problem(2.0)
    x = small.draw(4, np.random.default_rng(0))
    plain, anew = supremum(small, x, values(small)), supremum(large, x, values(large))
    with memoising() as searches:
        np.testing.assert_array_equal(supremum(small, x, values(small)), plain)
        searches.again()
        np.testing.assert_allclose(supremum(small, x, values(small)), plain)
        searches.again()
        again = supremum(large, x, values(large))
    assert not np.any(np.delete(again, wanted))
    np.testing.assert_allclose(again[wanted], anew[wanted], rtol=0.15)
    assert np.all(again[wanted] > 1.2 * plain[wanted])


def test_what_is_held_ends_with_its_block_even_by_an_error():
    with pytest.raises(ZeroDivisionError), memoising():
        raise ZeroDivisionError
    assert active_memo() is None
