"""Time and memory of a run: unreasonable sizes are refused before it starts.

The estimates are from measurements on a desk computer, to a factor of about three.
"""

from uvms_drake.common.errors import require

SAMPLE_BYTES = 4e3
"""Memory of a sample of all logged signals [B]."""
PLAN_BYTES = 2.5e3
"""Memory of a plan's program, over the square of its horizon [B]."""
STEP_SECONDS = 1e-3
"""Time of a step of the integrator [s]."""
INTERVAL_SECONDS = 1e-3
"""Time of making a plan, over its horizon [s]."""
MOST_BYTES = 4e9
"""Memory that a run may take [B]."""
MOST_HOURS = 8.0
"""Time that a run may take [h]."""


def check_cost(duration: float, log_period: float, max_step_size: float, time_step: float,
               horizon: int) -> None:
    """Raises `InvalidParameter` for the first size that makes a run too large.

    Args:
        duration: Simulated time [s].
        log_period: Time between two samples of the log [s].
        max_step_size: Largest step of the integrator [s].
        time_step: Time between two plans [s].
        horizon: Number of intervals of a plan.
    """
    plan = PLAN_BYTES * float(horizon) * float(horizon)
    require(plan <= MOST_BYTES, "mpc.horizon", horizon,
            f"at most {(MOST_BYTES / PLAN_BYTES) ** 0.5:.0f}: one plan would take "
            f"{plan / 1e9:.2g} GB of memory")
    for key, period, cost, most, unit in (
            ("log_period", log_period, SAMPLE_BYTES / 1e9, MOST_BYTES / 1e9, "GB of memory"),
            ("simulator.max_step_size", max_step_size, STEP_SECONDS / 3600.0, MOST_HOURS, "hours"),
            ("mpc.time_step", time_step, INTERVAL_SECONDS / 3600.0 * horizon, MOST_HOURS, "hours")):
        if period > 0.0:  # Other values are refused elsewhere.
            total = duration / period * cost
            require(total <= most, key, period,
                    f"at least {duration * cost / most:.2g} s, or the duration shorter: "
                    f"{duration:g} s would take about {total:.2g} {unit}")
