"""Interface of an ancillary law: its command, its errors and its bound along the run.

A law is a dataclass of its gains that derives from `AncillaryLaw`. A closed loop needs only its
`command`. It has a certificate if `tube.law_tube.register_tube` has its tube.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, NamedTuple, Self

import numpy as np

from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.model.uvms_model import Kinematics, UvmsModel


class Pair:
    """Motion of the real and of the nominal robot, and the signals that a law may take.

    The real robot is always first. Everything but 𝔮 and ζ is computed when it is read first: a law
    needs a part of it. The error of the velocity is `zeta[0] - zeta[1]`, that of pose and joints
    `uv.pose_difference(*y)`, which wraps the angles.

    Args:
        model: The prediction model.
        config: Configurations 𝔮, 𝔮̄ (2, 6+n) [m, rad].
        zeta: Velocities ζ, ζ̄ (2, 6+n) [m/s, rad/s].
    """

    contact: np.ndarray | None = None
    """Measured force 𝔉_s of the real robot on the surface (6,) [N, N m]; None: the model's."""
    wrench: np.ndarray | None = None
    """Present wrench τ_v of the thrusters on the vehicle (6,) in body axes [N, N m]; None: the
    commanded one."""
    estimate: np.ndarray | None = None
    """Observer's estimate δ̂ of the disturbance of the law's outputs (6+n,) [m/s², rad/s²]; None
    without an observer."""
    preview: np.ndarray | None = None
    """Feedforward preview τ̄(t + ℓ) − τ̄(t) of the plan's forces (6+n,) [N, N m]; None: commands act
    at once."""

    def __init__(self, model: UvmsModel, config: np.ndarray, zeta: np.ndarray):
        self._model, self.config, self.zeta = model, config, zeta

    def given(self, **signals: np.ndarray | None) -> Self:
        """Returns the pair with signals by their names; both share the values computed before."""
        out = copy(self)
        vars(out).update(signals)
        return out

    @cached_property
    def kinematics(self) -> Kinematics:
        """Geometry of the two robots, stacks (2,)."""
        return self._model.kinematics(self.config)

    @cached_property
    def y(self) -> np.ndarray:
        """Extended tasks y, ȳ (2, 6+n) [m, rad]."""
        if "kinematics" not in vars(self):
            return self._model.task_pose(self.config)
        return np.concatenate([self.kinematics.chi, self.config[:, 6:]], axis=-1)

    @cached_property
    def J_x(self) -> np.ndarray:
        """Jacobians J_x of the extended task at 𝔮 and 𝔮̄ (2, 6+n, 6+n)."""
        return self._model.extended(self.kinematics.J_chi)

    @cached_property
    def J_x_dot(self) -> np.ndarray:
        """Rates of J_x along the two motions (2, 6+n, 6+n) [1/s]."""
        return self._model.task_jacobian_rate(self.kinematics, self.zeta)

    @cached_property
    def inverse(self) -> np.ndarray:
        """Inverse Jacobian J_x(𝔮)⁻¹ (6+n, 6+n)."""
        return np.linalg.inv(self.J_x[0])


def pair_of(model: UvmsModel, state: np.ndarray, nominal_state: np.ndarray) -> Pair:
    """Returns the pair of motions at (𝔮, ζ) and at (𝔮̄, ζ̄) (2(6+n),) each, real or complex."""
    both = np.array([state, nominal_state])
    return Pair(model, both[:, : model.size], both[:, model.size:])


@dataclass(frozen=True)
class Command:
    """Command to thrusters and joints."""

    u: np.ndarray
    """Acceleration command u (6+n,) [m/s² (3), rad/s² (3+n)]."""
    tau: np.ndarray
    """Generalised force τ = M(𝔮) u (6+n,) [N (3), N m (3+n)]."""
    M: np.ndarray
    """Mass matrix M(𝔮) (6+n, 6+n)."""
    limited: bool = False
    """Whether a limit has cut the command."""
    filtered: bool = False
    """Whether the filter of the joints has cut the command."""
    raised: bool = False
    """Whether the law has failed, and this is the command in its place."""


FIELDS = ("task", "position", "orientation", "joints", "z", "r")
"""2-norms: of the error fed back (𝔢_y, or 𝔢 of the end-effector alone), of its rows 𝔢_p [m],
𝔢_o [rad], 𝔢_q [rad], of 𝔷 = ζ − ζ̄ and of 𝔯 [m/s, rad/s]."""


@dataclass(frozen=True)
class Deviation:
    """Real motion relative to the nominal one, at an instant."""

    task: np.ndarray
    """Error that the law feeds back: 𝔢_y (6+n,), or 𝔢 (6,)."""
    e_y: np.ndarray
    """Error of the extended task, 𝔢_y = y − ȳ (6+n,) [m, rad]."""
    z: np.ndarray
    """Error of the velocity, 𝔷 = ζ − ζ̄ (6+n,) [m/s, rad/s]."""
    r: np.ndarray
    """Velocity error 𝔯 that the law drives to zero (6+n,) [m/s, rad/s]."""

    @cached_property
    def norms(self) -> np.ndarray:
        """Norms (6,) of `FIELDS`."""
        e_y = self.e_y
        return np.array([math.sqrt(x @ x) for x in (
            self.task, e_y[:3], e_y[3:6], e_y[6:], self.z, self.r)])


@dataclass(frozen=True)
class RunBound:
    """Bound on the deviation along the run: the solution of a differential equation."""

    size: int
    """Number of its states x."""
    rate: Callable[[np.ndarray, Pair], np.ndarray]
    """ẋ (size,) at x (size,)."""
    bounds: Callable[[np.ndarray, Pair], np.ndarray]
    """Bounds (6,) of `FIELDS` at x (size,); inf where there is none."""


class Outputs(NamedTuple):
    """Outputs that a law feeds back, of the real and the nominal robot, the real one first."""

    error: np.ndarray
    """Error e = y − ȳ of the outputs y (6+n,), angles wrapped."""
    rate: np.ndarray
    """Rates ẏ, ẏ̄ (2, 6+n)."""
    J: np.ndarray
    """Jacobians J_y (2, 6+n, 6+n): ẏ = J_y ζ."""
    bias: np.ndarray
    """Bias J̇_y ζ (2, 6+n)."""


@dataclass(frozen=True)
class Observed:
    """Outputs of a law whose disturbance is estimated by a `RowObserver`."""

    rates: np.ndarray
    """Rate λ of each output (6+n,) [1/s]; zero for an output that is not observed."""
    period: float
    """Time between two estimates [s]."""
    outputs: Callable[[Pair], Outputs]
    """Outputs of a pair of motions."""


class AncillaryLaw(ABC):
    """Law that keeps the robot near the plan; the dataclass of its gains.

    A closed loop needs its `command` alone. The defaults of the other methods serve monitor and
    certificate, and claim nothing: no bound along the run, errors of the whole extended task.
    """

    k: float = math.nan
    """Gain of the velocity error [1/s]; NaN where a law has none."""
    sigma: float = math.nan
    """σ, gain of the task error [1/s]; NaN where a law has none."""

    takes_force: ClassVar[bool] = False
    """Whether the command takes `Pair.contact`."""
    takes_wrench: ClassVar[bool] = False
    """Whether the command takes `Pair.wrench` and `Pair.preview`, of actuators with a delay."""

    @property
    def name(self) -> str:
        """Name in summaries and certificates."""
        return type(self).__name__.lower()

    @property
    def protects_joints(self) -> bool:
        """Whether the law feeds back 𝔢_y, the joints in it, and not 𝔢 of the end-effector alone."""
        return True

    @abstractmethod
    def command(self, model: UvmsModel, now: Pair, nominal_acceleration: Callable[[], np.ndarray],
                nominal_input: Callable[[], np.ndarray]) -> Command | np.ndarray:
        """Returns the acceleration u (6+n,) [m/s², rad/s²] alone, or the whole command.

        Args:
            model: The prediction model.
            now: Measured and nominal motion.
            nominal_acceleration: Function that returns ζ̄̇ (6+n,) [m/s², rad/s²].
            nominal_input: Function that returns ū (6+n,) [m/s², rad/s²]; it costs an evaluation of
                f.
        """

    def observed(self, model: UvmsModel) -> Observed | None:
        """Returns the outputs of which `Pair.estimate` is the disturbance, if there are any."""
        return None

    def deviation(self, now: Pair) -> Deviation:
        """Returns the errors of the law's tube; by default 𝔢_y, and 𝔷 for 𝔯."""
        e_y, z = pose_difference(*now.y), now.zeta[0] - now.zeta[1]
        return Deviation(e_y, e_y, z, z)

    def run_bound(self, d_bound: float, weights: np.ndarray) -> RunBound | None:
        """Returns the bound along a run of the dynamics, if the law has one.

        Args:
            d_bound: d̃, bound of ‖Ŵ⁻¹d‖₂, and so of ‖d‖₂.
            weights: Diagonal of Ŵ (6+n,), at most 1.
        """
        return None
