"""Retreat of a robot that has left its class: its reference, its law, and the filter of the joints.

The reference is a pose of the vehicle and joint angles, integrated from the measured ones at the
trip, in two modes:

    RETREATING  the vehicle goes back along −n; if a force was read in the last second, the joints
                draw the tip back too, by those that are not at their stops along (n·J_q)⁺, which is
                faster than any vehicle, and wherever that goes meanwhile.
                → STANDING: the vehicle is `distance` back, by its measured position
    STANDING    station, with the joints held.
                → RETREATING: the vehicle is pushed back towards the wall
                → WATCHING: `resume` has been given for `SETTLED`, with every ratio below one

If the water pushes harder than declared for `PATIENCE`, after the time that the way takes, the bow
turns into it. In both modes the reference leads the vehicle by a leash at most, for a thruster at
its limit that is asked for more leaks into the other axes; the goal stays where it is. While the
state is lost, the reference rests. The law is `tip first` with the joints as its tip's rows, for
which J_sq is the identity: it is never singular.
"""

from typing import NamedTuple

import numpy as np

from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.laws.tip_first import BlockGains, TipFirst
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.uvms_model import UvmsModel

WATCHING, RETREATING, STANDING = range(3)
"""Modes of a `Supervisor`."""
LEASH = 0.25
"""Largest distance of the reference from the vehicle along each axis [m]: one that a thruster does
not hold takes no other with it."""
ARRIVED, AGAIN = 0.2, 0.4
"""Shares of the distance that are left when the vehicle stands, and when it retreats again."""
ROUNDING = 1e-9
"""Distance that is none [m]."""
SHARE = 0.8
"""Share of a joint's largest speed that the retreat uses."""
MARGIN = 0.01
"""Distance from its stop at which a joint is held [rad, m]."""
REACTION = 0.06
"""Time in which the filter takes a joint to the speed that it may have [s]."""
BRAKING = 4.0
"""Deceleration that the filter counts on [rad/s², m/s²]."""
PATIENCE = 2.0
"""Time for which the water pushes before the bow turns into it [s]."""
SETTLED = 3.0
"""Time for which it stands before it goes on [s]."""
TURNING_FROM = 2.0
"""Disturbance over the threshold of `drift` from which on it does."""
TURNING = 0.1
"""Speed of that turn [rad/s]."""


class RetreatSettings(NamedTuple):
    """Distances and speeds of a retreat, and limits of the joints."""

    direction: np.ndarray
    """n, into the wall (3,)."""
    distance: float
    """Distance of the vehicle [m]."""
    speed: float
    """Speed of the vehicle [m/s]."""
    draw: float
    """Distance by which the joints draw the tip back [m]."""
    draw_speed: float
    """Speed of the tip at that [m/s]."""
    lower: np.ndarray
    """Stops of the joints (n,) [rad, m]."""
    upper: np.ndarray
    """Stops of the joints (n,) [rad, m]."""
    joint_speed: np.ndarray
    """Largest speeds of the joints (n,) [rad/s, m/s]."""
    thrusters: ThrusterModel | None = None
    """Thrusters, the power of each of which can be cut; None: it cannot."""


class Reference(NamedTuple):
    """Reference of the retreat; all arrays, so that it is a discrete state."""

    config: np.ndarray
    """𝔮 (6+n,) [m, rad]."""
    rate: np.ndarray
    """𝔮̇ (6+n,) [m/s, rad/s]."""
    start: np.ndarray
    """Position of the vehicle at the trip (3,) [m]; the goal is `distance` back from it."""
    left: np.ndarray
    """Distance that the vehicle as measured still has to go, and depth n·𝔭 to which the joints draw
    the tip, as the vehicle is, inf for none (2,) [m]."""


def begun(settings: RetreatSettings, model: UvmsModel, config: np.ndarray, touched: bool
          ) -> Reference:
    """Returns the reference at the trip, the measured 𝔮 (6+n,); after a touch the tip is drawn."""
    depth = float(settings.direction @ model.task_pose(config)[:3])
    left = np.array([settings.distance, depth - settings.draw if touched else np.inf])
    return Reference(config.copy(), np.zeros_like(config), config[:3].copy(), left)


def moved(settings: RetreatSettings, model: UvmsModel, now: Reference, config: np.ndarray,
          step: float, heading: float | None) -> Reference:
    """Returns the reference a step later.

    Args:
        settings: Distances and speeds.
        model: Supplies J_q.
        now: The reference.
        config: Measured 𝔮 (6+n,).
        step: Step [s].
        heading: Heading to which the vehicle turns [rad]; None: none.
    """
    n, rate, left = settings.direction, np.zeros_like(now.config), now.left.copy()
    left[0] = settings.distance - n @ (now.start - config[:3])
    remaining = settings.distance - float(n @ (now.start - now.config[:3]))
    if remaining > ROUNDING:
        rate[:3] = -min(settings.speed, remaining / step) * n
    low, high = settings.lower + 2.0 * MARGIN, settings.upper - 2.0 * MARGIN
    placed, q = np.append(config[:6], now.config[6:]), now.config[6:]
    deeper = float(n @ model.task_pose(placed)[:3]) - left[1]
    if deeper > 0.0:
        J = n @ model.task_jacobian(placed)[:3, 6:]
        J = np.where(((J < 0.0) & (q >= high)) | ((J > 0.0) & (q <= low)), 0.0, J)
        back = -J / max(float(J @ J), ROUNDING)
        fastest = SHARE * np.min(
            settings.joint_speed / np.maximum(np.abs(back), ROUNDING), initial=np.inf)
        rate[6:] = min(settings.draw_speed, fastest, deeper / step) * back
    if heading is not None:
        off = (heading - now.config[5] + np.pi) % (2.0 * np.pi) - np.pi
        rate[5] = np.clip(off / step, -TURNING, TURNING)
    out = now.config + step * rate
    joints = np.clip(out[6:], np.minimum(low, q), np.maximum(high, q))
    rate[6:], out[6:] = (joints - q) / step, joints
    lead = out[:3] - config[:3]
    out[:3] = config[:3] + np.clip(lead, -LEASH, LEASH)
    rate[:3] *= np.abs(lead) <= LEASH
    return Reference(out, rate, now.start, left)


def stands(settings: RetreatSettings, standing: bool, left: np.ndarray) -> bool:
    """Returns whether the vehicle stands, after whether it did and the distances left (2,) [m]."""
    return bool(left[0] <= (AGAIN if standing else ARRIVED) * settings.distance)


def law_of_retreat(law: AncillaryLaw, num_joints: int) -> TipFirst:
    """Returns the law of the retreat: the gains of a law, with the joints as the tip's rows."""
    rows = [f"q{i + 1}" for i in range(num_joints)]
    if isinstance(law, TipFirst):
        return TipFirst(law.vehicle, law.tip, rows, law.undriven, law.observer_period)
    gains = [np.nan_to_num(each) or default for each, default in ((law.k, 2.0), (law.sigma, 1.0))]
    return TipFirst(BlockGains(*gains), BlockGains(*gains), rows)


def allowed_acceleration(settings: RetreatSettings, q: np.ndarray, rates: np.ndarray
                         ) -> tuple[np.ndarray, np.ndarray]:
    """Returns bounds (n,), (n,) of q̈ with which joints stop before their stops [rad/s², m/s²].

    The largest speed towards a stop at a distance d is √(2 a d), less than that of the motor; it is
    reached in the reaction time T: q̈ ≤ (min(√(2 a (q₊ − m − q − q̇₊T)₊), V) − q̇)/T, and likewise
    towards q₋.

    Args:
        settings: Stops and largest speeds.
        q: Joint coordinates (n,) [rad, m].
        rates: q̇ (n,) [rad/s, m/s].
    """
    def upper(distance: np.ndarray, rates: np.ndarray) -> np.ndarray:
        left = np.maximum(distance - MARGIN - REACTION * np.maximum(rates, 0.0), 0.0)
        fastest = np.minimum(np.sqrt(2.0 * BRAKING * left), settings.joint_speed)
        bound: np.ndarray = (fastest - rates) / REACTION
        return bound

    return -upper(q - settings.lower, -rates), upper(settings.upper - q, rates)


def filtered_torque(settings: RetreatSettings, M: np.ndarray, bias: np.ndarray, tau: np.ndarray,
                    wrench: np.ndarray, q: np.ndarray, rates: np.ndarray
                    ) -> tuple[np.ndarray, bool]:
    """Returns the joints' torques (n,) [N m, N] that keep the joints within limits, and if it cuts.

    With the wrench on the vehicle, M ζ̇ + b = (τ_v, τ_q) predicts q̈; where it is not allowed, q̈ is
    cut and τ_q solved again. Without a cut τ_q stays as it is, to the bit.

    Args:
        settings: Stops and largest speeds.
        M: Mass matrix (6+n, 6+n).
        bias: b, with the force on the wall (6+n,) [N, N m].
        tau: Commanded τ (6+n,) [N, N m].
        wrench: Present τ_v (6,) [N, N m].
        q: Joint coordinates (n,).
        rates: q̇ (n,).
    """
    low, high = allowed_acceleration(settings, q, rates)
    predicted = np.linalg.solve(M, np.append(wrench, tau[6:]) - bias)[6:]
    if not ((predicted < low) | (predicted > high)).any():
        return tau[6:], False
    joints = np.clip(predicted, low, high)
    vehicle = np.linalg.solve(M[:6, :6], wrench - bias[:6] - M[:6, 6:] @ joints)
    torque: np.ndarray = M[6:, :6] @ vehicle + M[6:, 6:] @ joints + bias[6:]
    return torque, True
