"""The constants of the tube, estimated: samples, local maximisation from the worst, safety factor.

All are suprema over a `ConstraintSet`, of the model that the controller uses:

    J_max       sup ‖J‖; J_position_max, J_attitude_max of its first and last three rows
    Jx_max      sup ‖J_x‖                  J_x = [J; 0 I], ẏ = J_x ζ, y = (χ, q)
    J_dot_max   sup ‖J̇‖                    along 𝔮̇ = Γζ [1/s]; J̇_x has the same norm

Norms are spectral; with weights Ŵ, A Ŵ takes the place of a matrix A. An estimate may be too small:
only `covering` proves a bound. A law of one's own registers those that its tube needs, see
`register_constant`.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np

from uvms_drake.common.errors import require
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.tube.estimates import Estimate
from uvms_drake.tube.search.constraint_set import ConstraintSet
from uvms_drake.tube.search.local_search import DIFFERENCE, climb
from uvms_drake.tube.search.search_problem import SearchProblem
from uvms_drake.tube.search.second_search import second_search

BATCH = 200
"""States evaluated at a time; larger batches leave the processor's cache."""
START_RANKS = (0, 1, 2, 3, 5, 8, 13, 21)
"""Ranks of the samples from which the local searches start, the worst first."""


@dataclass(frozen=True)
class Constant:
    """A bound used by the certificate, with its origin."""

    name: str
    value: float
    """Value in the certificate, in the unit of the constant."""
    how: Literal["estimated", "proven"]
    samples: int
    """Number of states (estimated) or boxes (proven) that were evaluated."""
    worst: dict[str, np.ndarray]
    """State `config`, `zeta` (6+n,) at which `sampled_value` is reached."""
    safety_factor: float
    """Ratio of `value` to `sampled_value` for an estimated supremum, its inverse for an infimum."""
    sampled_value: float
    """Worst value found at a state of the set."""

    def to_data(self) -> dict[str, Any]:
        """Returns the fields in types of JSON."""
        data = {field.name: getattr(self, field.name) for field in fields(self)}
        return data | {"worst": {key: list(map(float, x)) for key, x in self.worst.items()}}

    @staticmethod
    def from_data(data: dict[str, Any]) -> "Constant":
        """Returns the constant from the result of `to_data`."""
        worst = {key: np.array(x, dtype=float) for key, x in data["worst"].items()}
        return Constant(**(data | {"worst": worst}))


Matrices = dict[str, np.ndarray]


class MatrixGroup(NamedTuple):
    """Matrices that are computed together, as functions of states."""

    matrices: Callable[[ContactModel, np.ndarray, np.ndarray], Matrices]
    """Function of the model and of (𝔮, ζ) (m, 6+n) that returns the matrices (m, r, 6+n)."""
    product: Callable[[ContactModel, str, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
    """Function of the model, of a matrix's name A, of (𝔮, ζ) and of one vector v (6+n,) that
    returns A v (m, r), by one directional derivative instead of the whole matrix."""


class Quantity(NamedTuple):
    """A constant as the extreme singular value of a matrix function."""

    group: MatrixGroup
    matrix: str
    """Name of the matrix in its group."""
    unit: str = "-"
    """Unit of the constant; metres and radians mixed, from velocities to velocities none."""
    sign: float = 1.0
    """1: the supremum of the largest singular value; −1: the infimum of the smallest."""
    power: int = 1
    """Exponent of the extreme singular value in the constant."""
    rows: slice = slice(None)
    """Rows of the matrix."""
    columns: slice = slice(None)
    """Columns of the matrix."""
    weights: np.ndarray | float = 1.0
    """Factors of the columns (6+n,), the diagonal of Ŵ."""

    @property
    def is_infimum(self) -> bool:
        """Whether the constant is a lower bound."""
        return self.sign * self.power < 0.0

    def sigma(self, matrices: Matrices) -> np.ndarray:
        """Returns the extreme singular value (m,)."""
        A = (matrices[self.matrix] * self.weights)[:, self.rows, self.columns]
        return np.linalg.svd(A, compute_uv=False)[:, 0 if self.sign > 0.0 else -1]

    def value_and_gradient(self, model: ContactModel, config: np.ndarray,
                           zeta: np.ndarray) -> tuple[float, np.ndarray]:
        """Returns ± the singular value and its derivative ± uᵀ(dA)v in (𝔮, ζ) (2(6+n),)."""
        matrices = self.group.matrices(model, config[None], zeta[None])
        A = matrices[self.matrix][0] * self.weights
        U, sigma, Vh = np.linalg.svd(A[self.rows, self.columns], full_matrices=False)
        i = 0 if self.sign > 0.0 else -1
        v = np.zeros(model.size)
        v[self.columns] = Vh[i]
        steps = DIFFERENCE * np.eye(2 * model.size)
        x = np.concatenate([config, zeta])
        moved_config, moved_zeta = np.split(np.concatenate([x + steps, x - steps]), 2, axis=1)
        moved = self.group.product(
            model, self.matrix, moved_config, moved_zeta, self.weights * v)
        along = moved[:, self.rows] @ U[:, i]
        plus, minus = np.split(along, 2)
        return self.sign * float(sigma[i]), self.sign * (plus - minus) / (2.0 * DIFFERENCE)


def jacobian_matrices(model: ContactModel, config: np.ndarray, zeta: np.ndarray) -> Matrices:
    """Returns J (m, 6, 6+n) and J_x (m, 6+n, 6+n) at m states (m, 6+n)."""
    J_x = model.task_jacobian(config)
    return {"J": J_x[:, :6], "J_x": J_x}


def jacobian_product(model: ContactModel, matrix: str, config: np.ndarray, zeta: np.ndarray,
                     v: np.ndarray) -> np.ndarray:
    """Returns J v (m, 6) or J_x v (m, 6+n); see `MatrixGroup`."""
    J_x = model.task_jacobian(config)
    product: np.ndarray = (J_x[:, :6] if matrix == "J" else J_x) @ v
    return product


def rate_matrices(model: ContactModel, config: np.ndarray, zeta: np.ndarray) -> Matrices:
    """Returns J̇ (m, 6, 6+n) at m states; the other rows of J_x have none."""
    return {"J_dot": model.task_motion(config, zeta)[2][:, :6]}


def rate_product(model: ContactModel, matrix: str, config: np.ndarray, zeta: np.ndarray,
                 v: np.ndarray) -> np.ndarray:
    """Returns J̇ v (m, 6); see `MatrixGroup`."""
    return rate_matrices(model, config, zeta)[matrix] @ v


JACOBIAN = MatrixGroup(jacobian_matrices, jacobian_product)
RATE = MatrixGroup(rate_matrices, rate_product)

QUANTITIES = {
    "J_max": Quantity(JACOBIAN, "J"),
    "J_position_max": Quantity(JACOBIAN, "J", rows=slice(0, 3)),
    "J_attitude_max": Quantity(JACOBIAN, "J", rows=slice(3, 6)),
    "Jx_max": Quantity(JACOBIAN, "J_x"),
    "J_dot_max": Quantity(RATE, "J_dot", unit="1/s"),
}
"""Constants by name: those of the package's laws, and those of `register_constant`."""


def register_constant(name: str, quantity: Quantity) -> None:
    """Registers a constant for the tube of a law of one's own, see `law_tube.register_tube`.

    A certificate searches for it if the law of its scenario needs it.

    Raises:
        InvalidParameter: Another constant has this name.
    """
    known = QUANTITIES.get(name, quantity)
    again = _origin(known) == _origin(quantity)  # The cell of a notebook, a second time.
    require(again, "register_constant", name,
            "another name: a constant of this name is there already")
    QUANTITIES[name] = quantity


def _origin(quantity: Quantity) -> tuple[str, ...]:
    """Returns the matrix and the module and name of the function that computes it."""
    matrices = quantity.group.matrices
    return quantity.matrix, matrices.__module__, matrices.__qualname__


def sampled_values(model: ContactModel, config: np.ndarray, zeta: np.ndarray,
                   names: tuple[str, ...], weights: np.ndarray | float = 1.0
                   ) -> dict[str, np.ndarray]:
    """Returns the values behind each constant, e.g. ‖JŴ‖ for J_max, (m,) by name at m states."""
    wanted = {name: QUANTITIES[name]._replace(weights=weights) for name in names}
    parts: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for i in range(0, len(config), BATCH):
        state = config[i: i + BATCH], zeta[i: i + BATCH]
        groups = {quantity.group for quantity in wanted.values()}
        matrices = {group: group.matrices(model, *state) for group in groups}
        for name, quantity in wanted.items():
            parts[name].append(quantity.sigma(matrices[quantity.group]) ** quantity.power)
    return {name: np.concatenate(values) for name, values in parts.items()}


def estimate_constants(model: ContactModel, constraint_set: ConstraintSet,
                       names: tuple[str, ...], *, samples: int = 4000,
                       safety_factor: float = 1.05, seed: int = 0,
                       weights: np.ndarray | float = 1.0) -> dict[str, Constant]:
    """Returns the constants of this file by name; the same for the same arguments.

    Args:
        model: The controller's model.
        constraint_set: The set over which they are suprema.
        names: Names of the constants, keys of `QUANTITIES`.
        samples: Number of states sampled; local searches start from the worst of them.
        safety_factor: Factor of the suprema and divisor of the infimum, at least 1.
        seed: Seed of the samples.
        weights: Diagonal of Ŵ (6+n,), positive; 1 for the matrices themselves.
    """
    require(samples >= 1, "samples", samples, "a positive integer")
    require(1.0 <= safety_factor < np.inf, "safety_factor", safety_factor, "at least 1")
    if not names:
        return {}
    config, zeta = constraint_set.sample(model, samples, np.random.default_rng(seed))
    values = sampled_values(model, config, zeta, names, weights)
    ends = [end for name in names for end in _local_maxima(
        model, constraint_set, name, config, zeta, values[name], weights)]
    # A bad state for one constant is tried for all of them.
    config, zeta = (np.array(states) for states in zip(*ends, strict=True))
    values = sampled_values(model, config, zeta, names, weights)
    out = {}
    for name in names:
        infimum = QUANTITIES[name].is_infimum
        worst = int(np.argmin(values[name]) if infimum else np.argmax(values[name]))
        reached = float(values[name][worst])
        out[name] = Constant(
            name=name, value=reached / safety_factor if infimum else reached * safety_factor,
            how="estimated", samples=samples, worst={"config": config[worst], "zeta": zeta[worst]},
            safety_factor=safety_factor, sampled_value=reached)
    return out


def _local_maxima(model: ContactModel, constraint_set: ConstraintSet, name: str, config: np.ndarray,
                  zeta: np.ndarray, values: np.ndarray, weights: np.ndarray | float
                  ) -> list[tuple[np.ndarray, np.ndarray]]:
    """Returns the ends of local searches from the worst of the samples (m, 6+n)."""
    quantity = QUANTITIES[name]._replace(weights=weights)
    order = np.argsort(values if quantity.is_infimum else -values, kind="stable")
    starts = order[[rank for rank in START_RANKS if rank < len(order)]]
    return [climb(partial(quantity.value_and_gradient, model), model, constraint_set,
                  config[i], zeta[i])[1:] for i in starts]


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
