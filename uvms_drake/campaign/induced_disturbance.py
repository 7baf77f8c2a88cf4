"""Estimate, before a run, of the disturbance induced by model errors and the water's motion."""

from collections.abc import Sequence

import numpy as np
from pydrake.systems.framework import Diagram

from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.plan.plan import DynamicPlan
from uvms_drake.model.frames.spatial import times
from uvms_drake.plant.disturbance import Disturbance
from uvms_drake.plant.uvms_plant import set_state
from uvms_drake.plant.waves import Wave, water_motion

IN_A_WAVE = 8
"""Number of instants in a wave's period."""
WITHIN = 3
"""Number of points on each interval of a plan, the last of them the knot."""


def predicted_disturbance(uvms: Diagram, current: np.ndarray, waves: Sequence[Wave],
                          declared: Disturbance, plan: DynamicPlan, ocp: Ocp[DynamicPlan]
                          ) -> float:
    """Returns the largest size of ζ̇ − f(𝔮̄, ζ̄) − ū [m/s², rad/s²] at points of a plan, without d.

    The size is `Disturbance.norm`, which is to be at most d̃. ζ̇ is that of the simulated robot in
    the plan's state under its command τ = M(𝔮̄)ū. The last point is the task's equilibrium. Waves
    are sampled a few times in their longest period, since later plans meet other phases.

    Args:
        uvms: Robot of `make_simulated_uvms`, without a disturbance of its own.
        current: Velocity of the water (3,) [m/s].
        waves: Waves on top of it.
        declared: Disturbance with the weights of the size.
        plan: Nominal trajectory.
        ocp: Optimal control problem, with the controller's model.
    """
    model = ocp.model
    config, zeta, zeta_dot = _points(plan, model.configuration(ocp.y_des))
    u = zeta_dot - model.drift(config, zeta)
    tau = times(model.mass_matrix(model.kinematics(config)), u)
    state = np.hstack([config, zeta])
    longest = max((wave.period for wave in waves), default=0.0)
    instants = np.arange(IN_A_WAVE) / IN_A_WAVE * longest if waves else np.zeros(1)
    return max(float(np.max(declared.norm(
        _accelerations(uvms, state, tau, *water_motion(current, waves, instant)) - zeta_dot)))
        for instant in instants)


def _points(plan: DynamicPlan, goal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns 𝔮̄, ζ̄ and ζ̄̇ (K, 6+n) of a plan, the last row those of the `goal` 𝔮 at rest."""
    steps = np.linspace(0.0, len(plan.zeta_dot), WITHIN * len(plan.zeta_dot) + 1)
    points = [plan.at(plan.start_time + plan.time_step * step) for step in steps]
    at_rest = np.zeros_like(plan.zeta[-1])
    config, zeta, zeta_dot = zip(*points, (goal, at_rest, at_rest), strict=True)
    return np.array(config), np.array(zeta), np.array(zeta_dot)


def _accelerations(uvms: Diagram, state: np.ndarray, tau: np.ndarray, velocity: np.ndarray,
                   acceleration: np.ndarray) -> np.ndarray:
    """Returns ζ̇ (K, 6+n) of the simulated robot in the states (K, 2(6+n)) under τ (K, 6+n).

    The water has a velocity [m/s] and an acceleration [m/s²] (3,).
    """
    context = uvms.CreateDefaultContext()
    uvms.GetInputPort("current").FixValue(context, velocity)
    uvms.GetInputPort("current_acceleration").FixValue(context, acceleration)
    out = np.empty_like(tau)
    for i, (x, force) in enumerate(zip(state, tau, strict=True)):
        set_state(uvms, context, x)
        uvms.GetInputPort("tau").FixValue(context, force)
        out[i] = uvms.GetOutputPort("acceleration").Eval(context)
    return out
