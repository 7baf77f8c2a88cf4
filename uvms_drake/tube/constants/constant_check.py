"""Second search for constants that are estimated."""

from dataclasses import dataclass

import numpy as np

from uvms_drake.model.contact_model import ContactModel
from uvms_drake.tube.constants.constants import QUANTITIES, Constant, sampled_values
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.estimate import Estimate
from uvms_drake.tube.search.search_problem import SearchProblem
from uvms_drake.tube.search.second_search import second_search


@dataclass(frozen=True)
class ConstantProblem(SearchProblem):
    """Values behind one constant, or the inverse of an infimum; without errors."""

    name: str

    @property
    def channels(self) -> list[slice]:
        """The only channel."""
        return [slice(0, 1)]

    def values(self, x: np.ndarray, error: np.ndarray) -> np.ndarray:
        """Returns the norms (m, 1) at motions x (m, 3(6+n)), real."""
        pose, zeta, _ = np.split(x, 3, axis=-1)
        found = sampled_values(self.model, self.config(pose), zeta, (self.name,))[self.name]
        return (1.0 / found if QUANTITIES[self.name].is_infimum else found)[:, None]


def checked_constants(model: ContactModel, declared: ConstraintSet,
                      constants: tuple[Constant, ...], seed: int) -> tuple[Estimate, ...]:
    """Returns the estimates of constants, with Ŵ = I; an infimum's inverse is a supremum.

    Args:
        model: The controller's model.
        declared: Set of the constants.
        constants: Constants, of which the estimated ones count.
        seed: Seed of the search.
    """
    rng, none = np.random.default_rng([seed, 2]), np.zeros(1, dtype=int)
    out = []
    for constant in constants:
        if constant.how == "estimated":
            problem = ConstantProblem(model, declared, [], constant.name)
            second = float(second_search(problem, none, rng)[0])
            infimum = QUANTITIES[constant.name].is_infimum
            out.append(Estimate(f"1/{constant.name}" if infimum else constant.name,
                                1.0 / constant.value if infimum else constant.value, second))
    return tuple(out)
