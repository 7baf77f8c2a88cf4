"""Local maximisation of a function of the state over a `ConstraintSet`, with SNOPT."""

from collections.abc import Callable

import numpy as np
from pydrake.solvers import MathematicalProgram, SnoptSolver, SolverOptions

from uvms_drake.common.differentiable import differentiable
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.tube.search.constraint_set import ConstraintSet

DIFFERENCE = 1e-6
"""Step of the central differences, all in one batch."""
MARGIN = 1e-5
"""Distance that SNOPT keeps from the normalised bounds, so that it ends at a feasible point."""
SETTINGS = {"Major iterations limit": 60, "Major optimality tolerance": 1e-4,
            "Major feasibility tolerance": 1e-6}
"""Settings of SNOPT; a search may stop early."""

ValueAndGradient = Callable[[np.ndarray, np.ndarray], tuple[float, np.ndarray]]


class _Search:
    """The problem in coordinates s about the start, x = start + scale s, and its best state."""

    def __init__(self, function: ValueAndGradient, model: ContactModel,
                 constraint_set: ConstraintSet, start: np.ndarray):
        self._function = function
        self._model = model
        self._set = constraint_set
        self._start = start
        self._scale = constraint_set.scale(model)
        config, zeta = np.split(start, 2)
        value, _ = function(config, zeta)
        self._value_scale = abs(value) or 1.0
        self.best = value, config, zeta
        arm = slice(3, model.size)
        self.box = tuple((bound - start[arm]) / self._scale[arm] for bound in constraint_set.box)

    def objective(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns (1,) minus the function over its size at the start, and the gradient (1, d)."""
        config, zeta = np.split(self._start + self._scale * s, 2)
        value, gradient = self._function(config, zeta)
        if value > self.best[0] and self._set.contains(
                self._model, config[None], zeta[None], tolerance=0.0)[0]:
            self.best = value, config, zeta
        return (np.array([-value / self._value_scale]),
                -(self._scale * gradient)[None] / self._value_scale)

    def bounded(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns the values (c,) that have to be in [−1, 1], and their derivatives (c, d)."""
        steps = DIFFERENCE * np.eye(len(s))
        x = self._start + self._scale * np.concatenate([s[None], s + steps, s - steps])
        values = self._set.normalised(self._model, *np.split(x, 2, axis=1))
        plus, minus = np.split(values[1:], 2)
        return values[0], (plus - minus).T / (2.0 * DIFFERENCE)


def climb(function: ValueAndGradient, model: ContactModel, constraint_set: ConstraintSet,
          config: np.ndarray, zeta: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Returns value, 𝔮 and ζ (6+n,) of the best state met on the way to a local maximum.

    A largest singular value has kinks where it is not simple; SNOPT may stop there, and it may
    stop at a local maximum: the result is a value that is reached in the set, no more.

    Args:
        function: Maps 𝔮, ζ (6+n,) to a value and its gradient in (𝔮, ζ) (2(6+n),).
        model: The controller's model.
        constraint_set: The set.
        config: 𝔮 (6+n,) of the start, a state of the set.
        zeta: ζ (6+n,) of the start.
    """
    search = _Search(function, model, constraint_set, np.concatenate([config, zeta]))
    start = np.zeros(2 * model.size)
    prog = MathematicalProgram()
    s = prog.NewContinuousVariables(len(start))
    prog.AddBoundingBoxConstraint(*search.box, s[3: model.size])
    ones = (1.0 - MARGIN) * np.ones(len(search.bounded(start)[0]))
    prog.AddConstraint(differentiable(search.bounded), lb=-ones, ub=ones, vars=s)
    objective = differentiable(search.objective)
    prog.AddCost(lambda s: objective(s)[0], vars=s)
    options = SolverOptions()
    for key, value in SETTINGS.items():
        options.SetOption(SnoptSolver.id(), key, value)
    SnoptSolver().Solve(prog, start, options)
    return search.best
