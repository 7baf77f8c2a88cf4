"""What is certified of each step of a mission before it begins: force, time, and what voids it.

*The force.* The plan steers for 𝔵 with n·𝔵 = x + (F − F̂)/κ̂ − 𝔱·(𝔲 − 𝔭), x the depth of the tip 𝔭
at the last reading F̂ and 𝔲 the place, see `control.contact.target`; the inclination 𝔱 is at most α
long. With the tip in its tube, x = x̄ + ε, and a plan that is short of 𝔵 by a vector 𝔪 this is
F̂ − F = κ̂ε', |ε'| ≤ E + ℓ, E = E_n + αE_t, ℓ = |n·𝔪| + α‖P_t 𝔪‖. The reading is of up to a time W
ago, and off by ν. What it is of is φ(1 + cδ̇) with |cδ̇| ≤ d = c₊s, at a speed s of at most the
tube's and what the wall recedes on the way, s = Ė_n + αĖ_t + αv for a slide at v. Since then the
tip has come nearer by at most min(2E, sW), and damping may have another sign. So with κ̂ ≤ κ₊

    |n·𝐅 − F| ≤ b(ℓ) = (1 + d) ((F + ν + κ₊(E + ℓ)) / (1 − d) + κ₊ min(2E, sW)) − F.

How far a plan is short is known while it is followed, not before: at its target ℓ = 0. It is the
force along n. By tilt and friction that along the wall's own normal is between 1/(cos θ + μ sin θ)
and 1/(cos θ − μ sin θ) of it.

*At all times* the static force is at most `contact.force`, whatever the plan is short of.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uvms_drake.control.limits import TubeRadii, resolved_radii
from uvms_drake.mission.steps import AnyStep, Approach, Hold, Mission, Slide
from uvms_drake.model.surface import SensedContact
from uvms_drake.tube.conditions import Condition


@dataclass(frozen=True)
class Leg:
    """A step of a mission."""

    kind: str
    force: float
    """Largest force that it asks for [N]."""
    band: float | None
    """b(0) of a hold or slide [N]."""
    least: float
    """Time that it takes at least, if nothing fails [s]."""
    most: float
    """Time-out [s]."""
    void: str
    """The condition that fails, or nothing."""


def force_band(contact: SensedContact, tube: TubeRadii, force: float, speed: float,
               short: float = 0.0) -> float:
    """Returns b [N], see the module; inf if damping may hide any force.

    Args:
        contact: What is known of the wall.
        tube: The radii, those of the tip filled in.
        force: F [N].
        speed: v [m/s].
        short: ℓ [m].
    """
    radii, tilt, stiffness = resolved_radii(tube), contact.walls.tilt, contact.stiffness
    E = (radii.depth or 0.0) + tilt * (radii.position or 0.0)
    s = (radii.depth_speed or 0.0) + tilt * ((radii.tip_speed or 0.0) + speed)
    d = contact.dissipation * s
    if d >= 1.0:
        return np.inf
    before = (force + contact.force_error + stiffness * (E + short)) / (1.0 - d)
    return (1.0 + d) * (before + stiffness * min(2.0 * E, s * contact.delay)) - force


def least_time(step: AnyStep) -> float:
    """Returns the time that a step takes at least if nothing fails [s]; zero where none is known.

    How long it is on its way to a place off the wall and to a wall is known to nobody.
    """
    if isinstance(step, Slide):
        return step.time
    return step.settle if isinstance(step, Approach) else step.seconds if isinstance(step, Hold) \
        else 0.0


def legs_of(mission: Mission, contact: SensedContact, tube: TubeRadii,
            conditions: Sequence[Condition]) -> list[Leg]:
    """Returns the legs of a mission.

    Args:
        mission: Checked.
        contact: What is known of the wall.
        tube: The radii.
        conditions: Those of the certificate, of which some have a step's name.
    """
    legs = []
    for i, step in enumerate(mission.steps):
        speed = step.speed if isinstance(step, Slide) else 0.0
        failed = next((each for each in conditions if not each.holds
                       and each.name.startswith(f"mission.steps[{i}],")), None)
        legs.append(Leg(
            type(step).__name__, step.strongest,
            force_band(contact, tube, step.strongest, speed)
            if isinstance(step, Hold | Slide) else None,
            least_time(step), step.timeout,
            "" if failed is None else str(failed)))
    return legs
