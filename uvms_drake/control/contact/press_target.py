"""Where to press next: the depth at which the wall should give the desired force.

*In contact* x_target = x + (F_des − F)/κ̂. If the tip gets there, the error e = F_des − F becomes

    e' = e − (φ(x_target) − φ(x)) = (1 − κ/κ̂) e,     κ the wall's mean slope over that step:

a contraction iff 0 < κ < 2κ̂, without overshoot iff κ ≤ κ̂, at once for κ̂ = κ. A step that is cut
short keeps that: for κ ≤ κ̂ the error shrinks by less and keeps its sign.

*While it moves.* Plans are made on the way, and κ̂ is learned on the way. Let x° be where the wall
gives F_des, κ_t and κ̂_t slopes of now, and the tip be what a plan makes of the targets,
x − x° = G(x_target − x°), with the gain Γ from peak to peak. As

    x_target − x° = x + (F_des − φ(x))/κ̂_t − x° = (1 − κ_t/κ̂_t)(x − x°),

the loop is stable, by small gain, if Γ sup_t |1 − κ_t/κ̂_t| < 1, for any wall and any κ̂ of such
ratios: κΓ/(Γ + 1) < κ̂ < κΓ/(Γ − 1). A tip that follows steps without overshoot has Γ = 1, so that
κ̂ > κ/2 is enough; one that swings to them with a damping ζ has Γ = coth(½πζ/√(1 − ζ²)), 1.05 at
ζ = 0.77. So `slope` need be no better than that: 0.6κ is as stable as κ₊, and costs less time.

*On a wall that runs off n* and for a place 𝔲 at which the tip 𝔭 is not, the wall is deeper there by
−𝔱·(𝔲 − 𝔭), 𝔱 its inclination, estimated too, and so is the target. Without it, a tip that follows a
place at speed v, T behind, has a target that recedes by v tan θ, and a force that is off by
κ̂T v tan θ all the way.

*What moves is followed late.* A plan is quadratic about its reference: following one that moves at
v it is T v behind, T = h(1 − Φ)⁻¹ on 𝔭 for the terminal controller's Φ. T is a matrix, so a slide
along d leaves n·Td v along n, too: 0.04 s of it, 0.7 mm and 0.5 N too deep at 20 mm/s and 700 N/m,
are what a steady slide of `girona500_inspection` is off by.

*What remains.* With a reading F + n, |n| ≤ ν, and a tip off its target by ε, |ε| ≤ E_n, the tip
moves by (e − n)/κ̂ + ε and e' = (1 − κ/κ̂) e + (κ/κ̂) n − κε, so in the end

    |F − F_des| ≤ (κν/κ̂ + κE_n) / (1 − |1 − κ/κ̂|),

for κ̂ ≥ κ that is ν + κ̂E_n ≤ ν + κ₊E_n; below κ it is *more*: 5ν + 3κE_n at κ̂ = 0.6κ. (Proven for a
target that is held until it is reached.) With the planned depth x̄ in place of the measured one, a
constant ε leaves no error at all, for then the target integrates, but one that jumps between ±E_n
leaves ν + 2κ̂E_n.

*Plans that come later*, or go only a part α of the way, undo no contraction. Let places be
x_{i+1} = (1 − α_i)x_i + α_i x_target, 0 < α ≤ α_i ≤ 1, with the target of one of the last n + 1. On
a straight wall and with r = |1 − κ/κ̂| < 1, |e_{i+1}| ≤ (1 − α_i(1 − r)) max|e| over those: no error
grows, and after n + 1 steps all are at most 1 − α(1 − r) times the largest before.

*What can be reached.* The front lets the planned tip go on from a place with force F as long as
(F_max − (F + 2ν)/a₋)/κ₊ > 2E, a₋ the class's `share`: F_des < a₋(F_max − 2κ₊E) − 2ν. A touch
remains one at F_des > 3ν + κ₊E_n.

*Without contact.* Before the first one, the target is beyond the front: a search, as fast as the
limits of speed and front let it. If it is lost, the law goes on with no force from where the wall
should begin, or from where the tip is, if that is further: it comes back to a wall it has left, and
follows one that yields. A wall that should be felt there and is not is forgotten
(`slope.with_reading`), and the search begins again. While the tip is `LATERAL_TOLERANCE` of its place or
further it steers for the depth at which it is: where a tip touches, it is dragged along the wall
from there on, slowly and against the friction. So it goes no deeper by the plan, but by what it is
off the plan, e: with a plan that follows T behind it creeps at e/T. A place that runs away from a
tip, by more than `LATERAL_TOLERANCE` all the time, is not searched at. It aims `SEARCH_DEPTH` of the front and no
further: to move across n uses up α of the front for each metre, so a tip whose target is r away
stops αr beside its place; that has to be less than `LATERAL_TOLERANCE`, or it would wait there.

*A light press comes up slowly.* A tip at speed v that touches is κ₊vt_r deep in the stiffest wall,
in force, until a plan follows that knows of it, t_r later at most (`touch_to_plan`). For that to be
no more than 2F_des the search goes at v = 2F_des/(κ₊t_r), Tv ahead of a tip that follows T behind.

*Off the wall.* Whoever asks for it may say how deep to steer at most: to search no further, to go
back, to move along without a touch. The target is in no limit of the plan, so neither is that.

*Without readings.* The wall stands still, so what was safe is safe for ever: the front stays where
it is, plans behind it, and φ ≤ F_max as long as the tip is in its tube. But the law goes on with
the last force, off by what it changes, and after n readings, the sensor's `patience`, nobody knows
by more than nT sup|Ḟ| what the tube is. Then no force is asked for: the target is `retreat_depth`,
and the law is told no force (`HoldLastValue`). What it then lacks is the force itself. It takes the
tip back, for its acceleration J M⁻¹Jᵀ𝔉 has a part against an 𝔉 along n, J M⁻¹Jᵀ > 0; and as the
rows of the law have impulse responses that are not negative, to first order the real tip is no
deeper for it in its tube. (Friction and a tilted wall may turn 𝔉 so far that a little of it pulls
the tip in: 0.011 m/s² a newton at the worst posture of the main scenario, 0.2 mm at 45 N. No
certificate covers a lost force.) Once the wall is left nothing is lacked, and the tube is what it
was. With the first reading that comes again the law takes it, and the target presses or searches as
before.
"""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    LeafSystem,
    OutputPort,
)

from uvms_drake.common.errors import require, vector
from uvms_drake.common.wiring import added
from uvms_drake.control.contact.contact_estimator import ContactEstimator
from uvms_drake.control.contact.contact_state import ForceSensorModel

SEARCH_DEPTH = 0.1
"""How far beyond the front the search aims [m]."""
CLEARANCE = 0.05
"""How far the retreat goes back [m]."""
TINY = 1e-9
"""Force that is none [N]."""
OVER = 2.0
"""Force over F_des up to which a search may come before a plan knows of the touch."""
LATERAL_TOLERANCE = 0.05
"""How far from its place, across n, the tip goes no deeper in search of the wall [m]."""


def target_depth(desired: np.ndarray, reading: np.ndarray, touched: np.ndarray, slope: np.ndarray,
                 contact_depth: np.ndarray, safe_depth: np.ndarray,
                 depth_offset: np.ndarray | float = 0.0, lateral_error: np.ndarray | float = 0.0,
                 search_lead: float = np.inf) -> np.ndarray:
    """Returns the depth to steer for [m]; see the module. Of one wall, or of arrays of them.

    Args:
        desired: F_des, along n [N].
        reading: Depths x [m] and forces F [N] of the last readings (2, ...).
        touched: Whether those were touches.
        slope: κ̂ [N/m].
        contact_depth: Where the wall begins [m]; NaN: nobody knows.
        safe_depth: x_safe [m].
        depth_offset: −𝔱·(𝔲 − 𝔭), how much deeper the wall is at the place than at the tip [m].
        lateral_error: How far the tip is from the place, across n [m].
        search_lead: How far ahead of the tip it searches at most, for each newton that is asked for, if
            any is [m/N].
    """
    depth = np.where(touched, reading[0], np.maximum(reading[0], contact_depth))
    force = np.where(touched, reading[1], 0.0)
    pressing = depth + (desired - force) / slope + depth_offset
    lead = np.where(desired > 0.0, search_lead * np.maximum(desired, TINY), np.inf)
    search = np.where(
        lateral_error < LATERAL_TOLERANCE, np.minimum(safe_depth + SEARCH_DEPTH, reading[0] + lead), reading[0])
    return np.where(np.isnan(pressing), search, pressing)


def touch_to_plan(time_step: float, committed: int, sensing: ForceSensorModel) -> float:
    """Returns t_r [s], after which a plan that knows of a touch is followed at the latest.

    Args:
        time_step: h of the plans [s].
        committed: Number of intervals at the beginning of a plan that are not decided.
        sensing: The sensor.
    """
    return (1 + committed) * time_step + sensing.watched.window


def search_speed(force: float, stiffness: float, delay: float) -> float:
    """Returns the speed v of the search [m/s] for a desired force [N]; see the module.

    Args:
        force: F_des [N].
        stiffness: κ₊ [N/m].
        delay: t_r, from a touch to a plan that knows of it [s].
    """
    return OVER * force / (stiffness * delay)


def retreat_depth(reading: np.ndarray, contact_depth: np.ndarray) -> np.ndarray:
    """Returns the depth to steer for without readings [m]; see the module.

    `CLEARANCE` before the wall, or before the last reading where it is less deep or there is none.

    Args:
        reading: Depth x [m] and force of the last reading (2, ...).
        contact_depth: Where the wall begins [m]; NaN: nobody knows.
    """
    return np.fmin(reading[0], contact_depth) - CLEARANCE


class PressTarget(LeafSystem):
    """Puts out where the wall should give the desired force, and how far back to go without one.

    .. pydrake_system::

        name: PressTarget
        input_ports:
        - desired_force
        - place (optional)
        - deepest (optional)
        - reading
        - touched
        - slope
        - tilt
        - contact_depth
        - safe_depth
        - force_lost
        output_ports:
        - target

    - `desired_force` (1): F_des along n [N].
    - `place` (3): a point of the line along n on which to press, in Σ_I [m]; where it is not
      connected, or not finite, the default.
    - `deepest` (1): largest depth to steer for [m]; any, where it is not connected or not a number.
    - The others: those of an `ContactEstimator`.
    - `target` (3): the point of that line at `target_depth`, or at `retreat_depth` while the force
      is lost, in Σ_I [m].

    It has no state.

    Args:
        direction: n (3,).
        place: The default (3,) [m].
        search_lead: See `target_depth` [m/N].
    """

    def __init__(self, direction: np.ndarray, place: np.ndarray, *, search_lead: float = np.inf):
        super().__init__()
        require(search_lead > 0.0, "light", search_lead, "positive")
        self._search_lead = search_lead
        self._direction, self._place = vector("direction", direction, 3), vector("place", place, 3)
        self._desired_port = self.DeclareVectorInputPort("desired_force", 1)
        self._place_port = self.DeclareVectorInputPort("place", 3)
        self._deepest_port = self.DeclareVectorInputPort("deepest", 1)
        self._ports = {name: self.DeclareVectorInputPort(name, size) for name, size in (
            ("reading", 4), ("touched", 1), ("slope", 1), ("tilt", 3), ("contact_depth", 1),
            ("safe_depth", 1), ("force_lost", 1))}
        self.DeclareVectorOutputPort("target", 3, self._calc, {self.all_input_ports_ticket()})

    def _depth(self, context: Context, line: np.ndarray) -> np.ndarray:
        estimate = {name: port.Eval(context) for name, port in self._ports.items()}
        (*tip, force), tilt = estimate.pop("reading"), estimate.pop("tilt")
        depth, (lost,) = self._direction @ tip, estimate.pop("force_lost")
        reading, off = np.array([depth, force]), tip - depth * self._direction - line
        if lost:
            depth = retreat_depth(reading, estimate["contact_depth"])
        else:
            depth = target_depth(self._desired_port.Eval(context), reading, **estimate,
                                 depth_offset=tilt @ (tip - line), lateral_error=float(np.linalg.norm(off)),
                                 search_lead=self._search_lead)
        if self._deepest_port.HasValue(context):
            depth = np.fmin(depth, self._deepest_port.Eval(context))
        return depth

    def _line(self, context: Context) -> np.ndarray:
        """Returns the place's part across n (3,)."""
        place = self._place
        if self._place_port.HasValue(context) and np.all(
                np.isfinite(asked := self._place_port.Eval(context))):
            place = asked
        across: np.ndarray = place - (self._direction @ place) * self._direction
        return across

    def _calc(self, context: Context, output: BasicVector) -> None:
        line = self._line(context)
        output.SetFromVector(self._depth(context, line) * self._direction + line)

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, estimator: ContactEstimator, direction: np.ndarray,
                     place: np.ndarray, *, desired_force: OutputPort, search_lead: float = np.inf,
                     name: str = "press_target") -> "PressTarget":
        """Adds the target and connects it, but for `place` and `deepest`.

        Args:
            builder: Where to add it.
            estimator: What was felt.
            direction: n (3,).
            place: Where to press if nobody says where [m].
            desired_force: Gives F_des along n.
            search_lead: See the constructor.
            name: Name of the system.
        """
        system = PressTarget(direction, place, search_lead=search_lead)
        return added(builder, name, system, desired_force=desired_force, **{
            port: estimator.GetOutputPort(port) for port in system._ports})
