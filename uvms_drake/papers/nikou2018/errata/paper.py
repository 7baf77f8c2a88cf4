"""Numbers and robot of the paper, an erratum, and the table of all."""

import math
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from uvms_drake.certificate.certify import declared_set
from uvms_drake.common.schema import read_yaml
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.robot import Robot
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.spring import BilateralSpring
from uvms_drake.papers.nikou2018.transpose import TRANSPOSE, LemmaConstants
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.tube.constants import norms

# (sec:simulation_results), SI units and radians.
NUM_JOINTS = 4
CHI_START = np.array([-1.0, 1.3, -1.0, 0.0, -np.pi / 8, np.pi / 12])
CHI_DES = np.array([0.0, 0.0, 0.0, np.pi / 3, np.pi / 10, 0.0])
PITCH_LIMIT = np.pi / 2 - 0.1  # |θ| of the vehicle
J_MIN = 0.5095  # J̲
L_C = 2.0 * math.sqrt(2.0)  # L_𝔠
SIGMA = 3.084
AMPLITUDE = 0.2  # of w = 0.2 sin(t) in six components
W_BOUND = 0.2  # w̃
TUBE = 0.3  # radius of Ω
SPEED = 2.0  # bound of ‖ν₁‖, ‖ν₂‖ and ‖q̇‖
HORIZON, TIME_STEP = 7, 0.1  # T = 0.7 s
WEIGHT = 0.5  # Q = P = ½I₆, R = ½I₁₀

# Joint angles for its poses, within the printed ranges; the paper has none.
Q_START = np.array([0.0, 0.9, 0.278, 0.0])
"""Joint angles with which a level vehicle has the end-effector at χ(0)."""
Q_START_OTHER = np.array([1.29, 0.04, -1.15, -2.7])
"""Joint angles with which a tilted vehicle has it there."""
Q_DES = np.array([0.0, 1.2, 0.685, np.pi / 3])
"""Joint angles with which a level vehicle has the end-effector at χ_des."""

SAME = 1e-9
"""Difference below which two poses are the same, up to rounding [m, rad]."""
SAMPLES = 1000
"""States at which the constants of the Lemma are sampled."""


@dataclass(frozen=True)
class Erratum:
    """A statement of the paper and the result of a computation about it."""

    number: str
    """Number in the list: E1, E2, ..."""
    title: str
    where: str
    """LaTeX labels of the paper, with ", " between them."""
    printed: str
    """Statement of the paper."""
    computed: str
    """Result of the computation, made of computed numbers."""
    consequence: str
    wrong: bool
    """Verdict of the computation: whether the paper's statement fails."""

    @property
    def verdict(self) -> str:
        """Word for a table."""
        return "confirmed" if self.wrong else "not confirmed"


@cache
def _words() -> Any:
    """Returns the words of all errata, by number."""
    return read_yaml(Path(__file__).with_name("errata.yaml"))


def erratum(number: str, wrong: bool, **computed: Any) -> Erratum:
    """Returns an erratum: its words in errata.yaml with computed numbers, and the verdict."""
    return Erratum(number, wrong=wrong, **{
        key: text.format(**computed) for key, text in _words()[number].items()})


def errata_table(errata: list[Erratum], width: int = 100) -> str:
    """Returns the errata as plain text, `width` characters wide."""
    lines = [f"{sum(item.wrong for item in errata)} of {len(errata)} errata confirmed by "
             "computation"]
    for item in errata:
        lines += ["", *textwrap.wrap(
            f"{item.number:<5}{item.title} ({item.where}): {item.verdict}", width,
            subsequent_indent=" " * 5, break_on_hyphens=False)]
        for label in ("printed", "computed", "consequence"):
            lines += textwrap.wrap(
                getattr(item, label), width, initial_indent=f"     {label + ':':<13}",
                subsequent_indent=" " * 18, break_on_hyphens=False)
    return "\n".join(lines)


def errata_markdown(errata: list[Erratum]) -> str:
    """Returns the errata as a table for its page."""
    rows = [("", "erratum", "printed", "computed", "consequence", ""), ("---",) * 6]
    for item in errata:
        labels = ", ".join(f"`{label}`" for label in item.where.split(", "))
        rows.append((item.number, f"**{item.title}** ({labels})", item.printed, item.computed,
                     item.consequence, item.verdict))
    return "\n".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |"
                     for row in rows)


@cache
def robot() -> ContactModel:
    """Returns the paper's robot on the paper's spring, K = I₆ and χ_eq = 0."""
    return ContactModel(Robot.load("girona500_arm5e").uvms, check_surface(BilateralSpring()))


@cache
def robot_constants() -> tuple[LemmaConstants, np.ndarray]:
    """Returns the constants of (lemma:tube), sampled over the set of `girona500_ideal`, and a J.

    J (6, 10) is the sample of largest norm. The constants are estimates, on the small side.
    """
    scenario = load_scenario("girona500_ideal")
    model = load_model(scenario)
    config, zeta = declared_set(scenario.limits, model).sample(
        model, SAMPLES, np.random.default_rng(0))
    values = {name: norms(name, model, config, zeta) for name in TRANSPOSE}
    largest = model.kinematics(config[np.argmax(values["J_max"])]).J_chi
    first, *others = (float(np.max(each)) for each in values.values())
    return LemmaConstants(first**-2, *others), largest


def configuration(chi: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Returns the 𝔮 (..., 10) with the end-effector at χ (6,) and the joints at q (..., 4)."""
    return robot().configuration(np.concatenate([np.broadcast_to(chi, (*q.shape[:-1], 6)), q], -1))


def is_allowed(config: np.ndarray) -> bool:
    """Returns whether 𝔮 (10,) is within the printed limits of joints and pitch."""
    q = config[6:]
    return bool(np.all((robot().q_lower <= q) & (q <= robot().q_upper))
                and abs(config[4]) <= PITCH_LIMIT)


def smallest_eigenvalue(config: np.ndarray) -> np.ndarray:
    """Returns λ_min(J Jᵀ) (...) at 𝔮 (..., 10)."""
    return np.linalg.svd(robot().kinematics(config).J_chi, compute_uv=False)[..., -1] ** 2


@cache
def estimated_J_min() -> float:
    """Returns J̲ over the printed joint ranges and |θ| ≤ π/2 − 0.1: an estimate, from above."""
    model, edge = robot(), np.array([np.pi, PITCH_LIMIT])

    def value(x: np.ndarray) -> np.ndarray:
        """Returns λ_min(J Jᵀ) at x = (φ, θ, q); position and yaw do not matter."""
        return smallest_eigenvalue(np.insert(x, [0, 0, 0, 2], 0.0, axis=1))

    return local_search(value, np.concatenate([-edge, model.q_lower]),
                        np.concatenate([edge, model.q_upper]))[0]


@cache
def best_posture() -> tuple[float, np.ndarray]:
    """Returns the largest λ_min(J Jᵀ) found at χ_des within joint and pitch limits, and its q."""
    model = robot()

    def cost(q: np.ndarray) -> np.ndarray:
        config = configuration(CHI_DES, q)
        return np.where(np.abs(config[:, 4]) <= PITCH_LIMIT, -smallest_eigenvalue(config), 0.0)

    value, q = local_search(cost, model.q_lower, model.q_upper)
    return -value, q


def local_search(function: Callable[[np.ndarray], np.ndarray], lower: np.ndarray,
                 upper: np.ndarray, seed: int = 0) -> tuple[float, np.ndarray]:
    """Returns the smallest value found in a box, and where: samples, then ever smaller steps.

    Args:
        function: Maps points (m, d) to values (m,).
        lower: Lower corner of the box (d,).
        upper: Upper corner of the box (d,).
        seed: Seed of samples and steps.
    """
    rng = np.random.default_rng(seed)
    x = rng.uniform(lower, upper, (20_000, len(lower)))
    values = function(x)
    order = np.argsort(values, kind="stable")[:20]
    best, value, width = x[order], values[order], 0.1 * (upper - lower)
    for _ in range(60):
        steps = rng.normal(size=(20, 30, len(lower)))
        tried = np.clip(best[:, None] + width * steps, lower, upper)
        found = function(tried.reshape(-1, len(lower))).reshape(20, 30)
        row, child = np.arange(20), np.argmin(found, axis=1)
        better = found[row, child] < value
        best[better], value[better] = tried[row, child][better], found[row, child][better]
        width = 0.9 * width
    return float(np.min(value)), best[np.argmin(value)]


def number(value: float) -> str:
    """Returns a number as text, to three decimals."""
    return f"{round(value, 3) + 0.0:.4g}".replace("-", "−")  # No −0.


def numbers(values: np.ndarray) -> str:
    """Returns a vector as text, to three decimals."""
    return "(" + ", ".join(map(number, values)) + ")"
