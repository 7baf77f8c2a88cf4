"""Constants of the tube: suprema over a `ConstraintSet` of the norms of matrices, estimated.

    J_max       sup ‖J‖; J_position_max, J_attitude_max of its first and last three rows
    Jx_max      sup ‖J_x‖                  J_x = [J; 0 I], ẏ = J_x ζ, y = (χ, q)
    J_dot_max   sup ‖J̇‖                    along 𝔮̇ = Γζ [1/s]; J̇_x has the same norm

Norms are spectral; with weights Ŵ, A Ŵ takes the place of a matrix A. A norm is the largest ‖A w‖
over the unit ball, which `ascent` climbs for. An estimate may be too small: only `covering` proves
a bound. A law of one's own registers those that its tube needs, see `register_constant`.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.frames.spatial import times
from uvms_drake.tube.estimates import Estimate
from uvms_drake.tube.search.ascent import first_order, supremum
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.search_problem import Product, norm_problem
from uvms_drake.tube.search.second_search import again

PATIENCE, LEADERS = 3, 16
"""Effort of the ascent, see `ascent.supremum`: norms are cheap."""
BATCH = 200
"""States evaluated at a time."""


@dataclass(frozen=True)
class Constant:
    """A bound used by the certificate, with its origin."""

    name: str
    value: float
    """Value in the certificate, in the unit of the constant."""
    how: Literal["estimated", "proven"]
    samples: int
    """Number of states (estimated) or boxes (proven) that were evaluated."""
    sampled_value: float
    """Largest value found at a state of the set."""


class Quantity(NamedTuple):
    """A constant as the largest norm of a matrix A of the state."""

    product: Product
    """Function that returns A w of (model, 𝔮, ζ, w); of complex numbers, too."""
    unit: str = "-"
    """Unit of the constant; metres and radians mixed, from velocities to velocities none."""


def of_jacobian(rows: slice) -> Product:
    """Returns the product of some rows of J_x."""
    def product(model: ContactModel, config: np.ndarray, zeta: np.ndarray, w: np.ndarray
                ) -> np.ndarray:
        return times(model.task_jacobian(config)[..., rows, :], w)

    return product


def of_jacobian_rate(model: ContactModel, config: np.ndarray, zeta: np.ndarray, w: np.ndarray
                     ) -> np.ndarray:
    """Returns J̇ w (..., 6); the other rows of J̇_x w are zero."""
    return times(model.task_jacobian_rate(model.kinematics(config), zeta)[..., :6, :], w)


QUANTITIES = {
    "J_max": Quantity(of_jacobian(slice(0, 6))),
    "J_position_max": Quantity(of_jacobian(slice(0, 3))),
    "J_attitude_max": Quantity(of_jacobian(slice(3, 6))),
    "Jx_max": Quantity(of_jacobian(slice(None))),
    "J_dot_max": Quantity(of_jacobian_rate, "1/s"),
}
"""Constants by name: those of the package's laws, and those of `register_constant`."""


def register_constant(name: str, quantity: Quantity) -> None:
    """Registers a constant for the tube of a law of one's own, see `law_tube.register_tube`.

    A certificate searches for it if the law of its scenario needs it.

    Raises:
        InvalidParameter: Another constant has this name.
    """
    known = QUANTITIES.get(name, quantity).product
    again = (known.__module__, known.__qualname__) == (
        quantity.product.__module__, quantity.product.__qualname__)
    require(again, "register_constant", name,  # Again: the cell of a notebook, a second time.
            "another name: a constant of this name is there already")
    QUANTITIES[name] = quantity


def norms(name: str, model: ContactModel, config: np.ndarray, zeta: np.ndarray) -> np.ndarray:
    """Returns the norms behind a constant, e.g. ‖J‖ for J_max, (m,) at m states (m, 6+n)."""
    return np.concatenate([np.linalg.norm(QUANTITIES[name].product(
        model, config[i: i + BATCH, None], zeta[i: i + BATCH, None], np.eye(model.size)), 2,
        axis=(1, 2)) for i in range(0, len(config), BATCH)])


def estimate_constants(model: ContactModel, declared: ConstraintSet, names: tuple[str, ...], *,
                       samples: int, safety_factor: float, seed: int = 0,
                       weights: np.ndarray | float = 1.0) -> dict[str, Constant]:
    """Returns constants by name; the same for the same arguments.

    Args:
        model: The controller's model.
        declared: The set over which they are suprema.
        names: Names of the constants, keys of `QUANTITIES`.
        samples: Number of states sampled; the ascent starts from the worst of them.
        safety_factor: Factor of the suprema, at least 1.
        seed: Seed of the samples.
        weights: Diagonal of Ŵ (6+n,), positive; 1 for the matrices themselves.
    """
    require(samples >= 1, "samples", samples, "a positive integer")
    require(1.0 <= safety_factor < np.inf, "safety_factor", safety_factor, "at least 1")
    out = {}
    for name in names:
        problem = norm_problem(model, declared, QUANTITIES[name].product, weights)
        x = problem.draw(samples, np.random.default_rng(seed))
        values = first_order(problem, x)  # Exact, as A w is linear.
        climbed = supremum(problem, x, values, PATIENCE, LEADERS)
        found = float(max(climbed[0], np.max(values)))
        out[name] = Constant(name, safety_factor * found, "estimated", samples, found)
    return out


def checked_constants(model: ContactModel, declared: ConstraintSet,
                      constants: tuple[Constant, ...], seed: int) -> tuple[Estimate, ...]:
    """Returns the estimates among some constants, with Ŵ = I, each with its second search."""
    return tuple(Estimate(each.name, each.value, float(again(
        norm_problem(model, declared, QUANTITIES[each.name].product), np.zeros(1, dtype=int),
        np.array([each.value]), seed)[0])) for each in constants if each.how == "estimated")
