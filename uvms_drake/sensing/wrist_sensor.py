"""A wrist sensor of force and torque: lagging, sampled, quantised, noisy, biased and drifting.

Frames: W is World (Σ_I), E the end-effector (Σ_E), S the sensor, fixed to E. A wrench F_S is the
force and the torque about the origin of S, in its axes, that act *on* the surface, as 𝔉 does. By
virtual power F_E = A(𝔬)ᵀ𝔉, with χ̇ = A(𝔬)V_E, and F_E = X F_S (`transfer`). With L the wrench that
holds the tool beyond the sensor (`Tool.hold`), P that of a payload unknown to the model
(`plant.payload`), a bias b, a drift s, noise νₖ at tₖ = k h, a resolution r and L̂ₖ the model's L at
the measured attitude,

    T ẋ = F_S + L + P − x,     x(0) the same without accelerations,                             (1)
    rawₖ = clip(r round((x(tₖ) + b + s tₖ + νₖ)/r)),     F̂ₖ = rawₖ − L̂ₖ − tare,                 (2)
    𝔉_s(t) = A(𝔬)⁻ᵀ X F̂ₖ,     tₖ ≤ t < tₖ₊₁,                                                    (3)

`tare` the mean of raw − L̂ over the first samples, during which nothing is touched and F̂ is zero.
With the attitude 𝔬 measured at t, A(𝔬)ᵀ𝔉_s, which the inverse dynamics need, has no error of the
attitude in it. Bound of the error of F̂: sensing/theory.md#error-bound-of-the-force-sensor.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Annotated, NamedTuple

import numpy as np
from pydrake.systems import framework

from uvms_drake.common.alarm import warn
from uvms_drake.common.constraints import AtMost, Between, NotNegative, Positive, Rate, Vector
from uvms_drake.common.errors import require
from uvms_drake.common.finite import is_finite
from uvms_drake.common.keyed_random import normal_numbers
from uvms_drake.common.schema import check_values
from uvms_drake.common.wiring import WiredSystem, output_of
from uvms_drake.model.end_effector import force_in_tip, force_of_tip
from uvms_drake.model.frames.euler import rotated_back, rotation_matrix
from uvms_drake.model.frames.spatial import block_diagonal, cross, skew
from uvms_drake.model.uvms_model import UvmsModel

STREAM = 1
"""Key of the random numbers of force sensors."""


class Imperfection(NamedTuple):
    """Errors of one copy of a sensor, within its bounds."""

    bias: np.ndarray
    """b (6,) [N, N m]."""
    drift: np.ndarray
    """s (6,) [N/s, N m/s]."""
    noise: Callable[[int], np.ndarray]
    """νₖ (6,) [N, N m] of the sample k."""


def cut_noise(sigma: np.ndarray, multiple: float, seed: int, index: int) -> np.ndarray:
    """Returns νₖ (6,), k = `index`: Gaussian numbers cut to ± `multiple` · σ.

    It is a pure function of its arguments.
    """
    unit = normal_numbers(seed, (STREAM, 1, index), 6)
    return sigma * np.minimum(np.maximum(unit, -multiple), multiple)


def quantised(wrench: np.ndarray, resolution: np.ndarray) -> np.ndarray:
    """Returns the nearest multiples (6,) of a resolution (6,) [N, N m]; 0: the value itself."""
    if (resolution > 0.0).all():
        return resolution * np.rint(wrench / resolution)
    step = np.where(resolution > 0.0, resolution, 1.0)
    return np.where(resolution > 0.0, step * np.rint(wrench / step), wrench)


class Samples(NamedTuple):
    """State of a sensor: its samples."""

    taken: float
    """Number of samples so far."""
    total: np.ndarray
    """Sum of raw − L̂ over the samples of the tare (6,) [N, N m]."""
    last: np.ndarray
    """F̂ of the last sample (6,) [N, N m]."""

    @staticmethod
    def of(state: np.ndarray) -> "Samples":
        """Returns the parts of a state (13,)."""
        return Samples(state[0], state[1:7], state[7:])

    def with_next(self, wrench: np.ndarray, tare_samples: int) -> "Samples":
        """Returns the state after a sample of raw − L̂ (6,); see (2)."""
        if self.taken < tare_samples:
            return Samples(self.taken + 1, self.total + wrench, self.last)
        return Samples(self.taken + 1, self.total, wrench - self.total / max(tare_samples, 1))


def transfer(mounting: np.ndarray) -> np.ndarray:
    """Returns X (6, 6) with F_E = X F_S, for a wrench and the pose (6,) of S in E [m, rad]."""
    R_ES = rotation_matrix(mounting[3:])
    X = block_diagonal(R_ES, R_ES)
    X[3:, :3] = skew(mounting[:3]) @ R_ES
    return X


@dataclass
class Tool:
    """Tool beyond a wrist sensor, without which it would measure the contact alone.

    Only its weight and its buoyancy are in the reading: its inertia force, mass and added mass
    times some 0.1 m/s², and its drag are left out.
    """

    mass: Annotated[float, NotNegative] = 0.0
    """Mass [kg]."""
    centre: Annotated[np.ndarray, Vector(3)] = field(default_factory=lambda: np.zeros(3))
    """Centre of mass in the sensor's frame [m]."""
    displaced: Annotated[float, NotNegative] = 0.0
    """Mass of the water that it displaces [kg]."""
    buoyancy: Annotated[np.ndarray, Vector(3)] = field(default_factory=lambda: np.zeros(3))
    """Centre of buoyancy in the sensor's frame [m]."""
    error: Annotated[float, Between(-1, 1)] = 0.0
    """Relative error of the weight that the sensor's model takes off: too much, if positive."""

    @property
    def _moment(self) -> np.ndarray:
        """First moment of the mass less that of the water (3,) [kg m]."""
        return self.mass * np.asarray(self.centre) - self.displaced * np.asarray(self.buoyancy)

    def hold(self, g_S: np.ndarray) -> np.ndarray:
        """Returns the wrench (..., 6) [N, N m] about the sensor's origin that holds it at rest.

        −((m − m_w) g, (m c − m_w c_b) × g), m_w the mass of the water that it displaces.

        Args:
            g_S: Gravity in the sensor's axes (..., 3) [m/s²].
        """
        force = (self.mass - self.displaced) * g_S
        return -np.concatenate([force, cross(self._moment, g_S)], axis=-1)

    def largest_hold(self, gravity: float) -> np.ndarray:
        """Returns the largest components (6,) of `hold` in any attitude, ‖g‖ = `gravity`."""
        weight = abs(self.mass - self.displaced)
        a, b, c = self._moment**2
        return gravity * np.array([weight] * 3 + list(np.sqrt([b + c, a + c, a + b])))


@dataclass
class WristSettings:
    """Properties of a wrist sensor; its errors are bounds."""

    rate: Annotated[float, Rate] = 100.0
    """Samples per second [Hz]."""
    lag: Annotated[float, NotNegative] = 0.02
    """Time constant T [s]; zero for none."""
    noise: Annotated[np.ndarray, Vector(6), NotNegative] = field(
        default_factory=lambda: np.array([0.25] * 3 + [0.005] * 3))
    """Standard deviation σ of a sample (6,) [N (3), N m (3)]."""
    noise_multiple: Annotated[float, NotNegative] = 3.0
    """Multiple of σ to which the noise is cut, so that it is bounded."""
    least_noise: Annotated[float, Positive, AtMost(1)] = 1.0
    """Least standard deviation of a sample over σ: below 1 for a sensor that may be quieter than
    its declared noise, whose readings repeat more often; a frozen one is then found later."""
    resolution: Annotated[np.ndarray, Vector(6), NotNegative] = field(
        default_factory=lambda: np.array([0.0625] * 3 + [0.00133] * 3))
    """Step r of the readings (6,) [N (3), N m (3)]; zero for none."""
    bias: Annotated[np.ndarray, Vector(6), NotNegative] = field(
        default_factory=lambda: np.array([5.0] * 3 + [0.1] * 3))
    """Bound of each component of b (6,) [N (3), N m (3)]; b is drawn by the scenario's seed."""
    drift: Annotated[np.ndarray, Vector(6), NotNegative] = field(
        default_factory=lambda: np.array([0.002] * 3 + [0.00004] * 3))
    """Bound of each component of s (6,) [N/s (3), N m/s (3)]; s is drawn likewise."""
    range: Annotated[np.ndarray, Vector(6), NotNegative] = field(
        default_factory=lambda: np.array([2000.0] * 3 + [40.0, 40.0, 30.0]))
    """Largest readings either way (6,) [N (3), N m (3)]."""
    tare: float = 0.5
    """Time at the start during which nothing is touched and the mean is taken off [s]; 0: none."""
    mounting: Annotated[np.ndarray, Vector(6)] = field(default_factory=lambda: np.zeros(6))
    """Pose of the sensor in the frame of the end-effector: position, ZYX Euler angles [m, rad]."""
    tool: Tool = field(default_factory=Tool)
    """Tool beyond it."""

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning."""
        require(self.tare == 0.0 or 1.0 <= self.tare * self.rate < np.inf, "tare", self.tare,
                f"0, or at least one sample long, {1.0 / self.rate:g} s")

    @property
    def tare_samples(self) -> int:
        """Number of samples before the end of the tare."""
        return round(self.tare * self.rate)


class WristSensor(WiredSystem):
    """Measures the wrench on the surface; see the equations of this module.

    .. pydrake_system::

        name: WristSensor
        input_ports:
        - force
        - chi
        - measured_chi
        - payload (optional)
        - payload_at_rest (optional)
        output_ports:
        - force_measured
        - reading

    - `force`: 𝔉 (6), the true one, from the plant's port `force`.
    - `chi`: χ (6), the true pose of the end-effector; its attitude is read [m, rad].
    - `measured_chi`: χ (6) as it is measured.
    - `payload`: X P (6), the wrench by which the hand holds a payload, about the origin of Σ_E in
      its axes, and `payload_at_rest`, that at the start: from the plant's ports of these names;
      unconnected means an empty hand [N, N m].
    - `force_measured`: 𝔉_s (6), force in Σ_I and torque conjugate to Euler rates [N, N m].
    - `reading`: F̂ (6) in the sensor's axes, about its origin [N, N m]; zero during the tare.

    The continuous state is x (6), if there is a lag; the discrete state is that of `Samples` (13).
    A sample at which the measured pose is not finite is not taken, and the last one goes on. It
    warns on the logger `uvms_drake` if the surface is touched at the end of the tare.

    Args:
        model: Supplies gravity and the frame of the task.
        settings: The sensor.
        off: Errors of this copy.
    """

    def __init__(self, model: UvmsModel, settings: WristSettings, off: Imperfection):
        super().__init__()
        check_values(settings)
        self._settings, self._off = settings, off
        # The attitude in χ is about the axes of the task's frame Σ_T: forces come in them, too.
        self._gravity = (model.gravity @ model.R_WT).tolist()
        self._from_task = block_diagonal(model.R_WT, np.eye(3))
        self._range = np.asarray(settings.range, dtype=float)
        self._resolution = np.asarray(settings.resolution, dtype=float)
        self._X = transfer(np.asarray(settings.mounting, dtype=float))
        self._X_inverse = np.linalg.inv(self._X)
        # The tool's wrench is linear in gravity: L = H g_E.
        self._H = settings.tool.hold(self._X[:3, :3]).T
        self._force_port = self.DeclareVectorInputPort("force", 6)
        self._chi_port = self.DeclareVectorInputPort("chi", 6)
        self._measured_port = self.DeclareVectorInputPort("measured_chi", 6)
        self._payload_port = self.DeclareVectorInputPort("payload", 6)
        self._payload_at_rest_port = self.DeclareVectorInputPort("payload_at_rest", 6)
        if settings.lag > 0.0:
            self.DeclareContinuousState(6)
            self.DeclareInitializationUnrestrictedUpdateEvent(self._settle)
        self.DeclareDiscreteState(13)
        self.DeclarePeriodicDiscreteUpdateEvent(1.0 / settings.rate, 0.0, self._sample)
        samples, measured = self.xd_ticket(), self._measured_port.ticket()
        output_of(self, "force_measured", 6, self._force, {samples, measured})
        output_of(self, "reading", 6, lambda context: self._samples(context).last, {samples})

    def _hold(self, chi: np.ndarray) -> np.ndarray:
        """Returns L (6,) of the tool."""
        hold: np.ndarray = self._H @ rotated_back(chi[3:].tolist(), self._gravity)
        return hold

    def _wrench(self, context: framework.Context, payload: framework.InputPort) -> np.ndarray:
        """Returns F_S + L + P (6,), P that of a port."""
        chi = self._chi_port.Eval(context)
        force = force_in_tip(chi, self._force_port.Eval(context) @ self._from_task)
        if payload.HasValue(context):
            force = force + payload.Eval(context)
        wrench: np.ndarray = self._X_inverse @ force
        return wrench + self._hold(chi)

    def _settle(self, context: framework.Context, state: framework.State) -> None:
        if self._samples(context).taken == 0:
            state.get_mutable_continuous_state().SetFromVector(
                self._wrench(context, self._payload_at_rest_port))

    def DoCalcTimeDerivatives(
        self, context: framework.Context, derivatives: framework.ContinuousState) -> None:
        """Sets ẋ of (1)."""
        if self._settings.lag > 0.0:
            x = context.get_continuous_state_vector().CopyToVector()
            now = self._wrench(context, self._payload_port)
            derivatives.SetFromVector((now - x) / self._settings.lag)

    def _sample(self, context: framework.Context, state: framework.DiscreteValues) -> None:
        measured = self._measured_port.Eval(context)
        if not is_finite(measured):
            return
        samples = self._samples(context)
        tare = self._settings.tare_samples
        if samples.taken == tare - 1 and np.any(self._force_port.Eval(context)):
            warn(context.get_time(), "in touch at the end of the tare, which takes that force off")
        x = (context.get_continuous_state_vector().CopyToVector() if self._settings.lag > 0.0
             else self._wrench(context, self._payload_port))
        off, assumed = self._off, 1.0 + self._settings.tool.error
        raw = np.clip(quantised(
            x + off.bias + off.drift * context.get_time() + off.noise(int(samples.taken)),
            self._resolution), -self._range, self._range)
        taken, total, last = samples.with_next(raw - assumed * self._hold(measured), tare)
        state.set_value(np.concatenate([[taken], total, last]))

    @staticmethod
    def _samples(context: framework.Context) -> Samples:
        return Samples.of(context.get_discrete_state_vector().value())

    def _force(self, context: framework.Context) -> np.ndarray:
        chi = self._measured_port.Eval(context)
        if not is_finite(chi):
            return np.full(6, np.nan)
        return self._from_task @ force_of_tip(chi, self._X @ self._samples(context).last)
