"""Largest unevenness of the tip's acceleration along n between two readings of the force.

The safe region takes the tip's velocity between two readings as that on the line between the
velocities at the readings. An acceleration that varies by a within their interval h takes it off
that line by ah/4 at most. A bound of a, from jumps and from steady changes:
tube/contact/theory.md#unevenness-of-the-tips-motion.
"""

from dataclasses import dataclass

from uvms_drake.tube.contact.sensor_error import MeasuredForceBounds


@dataclass(frozen=True)
class TipAcceleration:
    """Accelerations of the tip's deviation along n by its sources, under a law."""

    by_force: float
    """A = ‖A_f‖ of the row of n of J_EM⁻¹J_Eᵀ [1/kg]."""
    by_normal: float
    """A_n = |A_f n| [1/kg]."""
    turning: float
    """ω, angular speed of the tip's axes [rad/s]."""
    other: float
    """d_n, bound of the acceleration by the disturbance and by the turn of the Jacobian [m/s²]."""


def unevenness(tip: TipAcceleration, force: MeasuredForceBounds, period: float, planned: float, *,
               read_between: bool) -> float:
    """Returns a [m/s²], such that the velocity is off the line between two readings by ah/4.

    With A, A_n, d_n and ω of `TipAcceleration`, the bounds of `MeasuredForceBounds` and the plan's
    variation p,

        a = 2d_n + A_n a_n + 2A a′ + ½h(A_n ρ + A(ρ′ + ωF̄)) + p,                           (4)

    but for the change of the feedback within h, which is assumed to add nothing. A reading of the
    sensor in between adds 2A(ε_f + a′) + A_n(a_n + ρh_s), h_s the sensor's period.

    Args:
        tip: The deviation of the tip.
        force: Forces and their readings.
        period: h, between two readings [s].
        planned: p, largest variation of the plan's acceleration along n within h [m/s²].
        read_between: Whether the sensor may give a reading between two instants of h.
    """
    # Steady changes count half: a line fits them best.
    steady = tip.by_normal * force.rate + tip.by_force * (
        force.tangential_rate + tip.turning * force.size)
    jumps = (2.0 * tip.other + tip.by_normal * force.ripple
             + 2.0 * tip.by_force * force.tangential_ripple)
    if read_between:
        jumps += (2.0 * tip.by_force * (force.error + force.tangential_ripple)
                  + tip.by_normal * (force.ripple + force.rate * force.period))
    return jumps + 0.5 * period * steady + planned
