"""Where to press next: the depth at which the wall should give the desired force.

*In contact* x_target = x + (F_des − F)/κ̂. If the tip gets there, the error e = F_des − F becomes

    e' = e − (φ(x_target) − φ(x)) = (1 − κ/κ̂) e,     κ the wall's mean slope over that step:

a contraction iff 0 < κ < 2κ̂, without overshoot iff κ ≤ κ̂, at once for κ̂ = κ. `slope` gives κ̂ ≥ κ
on a straight wall. A step that is cut short keeps that: for κ ≤ κ̂ the error shrinks by less and
keeps its sign.

*What remains.* With a reading F + n, |n| ≤ ν, and a tip off its target by ε, |ε| ≤ E_n, the tip
moves by (e − n)/κ̂ + ε and e' = (1 − κ/κ̂) e + (κ/κ̂) n − κε, so in the end

    |F − F_des| ≤ (κν/κ̂ + κE_n) / (1 − |1 − κ/κ̂|),

for κ̂ ≥ κ that is ν + κ̂E_n ≤ ν + κ₊E_n; below κ it is *more*: 5ν + 3κE_n at κ̂ = 0.6κ. (Proven for a
target that is held until it is reached; plans that are made on the way were tried, not proven.)
With the planned depth x̄ in place of the measured one, a constant ε leaves no error at all, for then
the target integrates, but one that jumps between ±E_n leaves ν + 2κ̂E_n.

*What can be reached.* The front lets the planned tip go on from a place with force F as long as
(F_max − F − 2ν)/κ₊ > 2E: F_des < F_max − 2ν − 2κ₊E. A touch remains one at F_des > 3ν + κ₊E_n.

*Without contact.* Before the first one, the target is beyond the front: a search, as fast as the
limits of speed and front let it. If it is lost, the law goes on with no force from where the wall
should begin, or from where the tip is, if that is further: it comes back to a wall it has left, and
follows one that yields. A wall that should be felt there and is not is forgotten
(`slope.without_contact`), and the search begins again.
"""

import numpy as np
from pydrake.systems.framework import (
    BasicVector,
    Context,
    DiagramBuilder,
    LeafSystem,
    OutputPort,
)

from uvms_drake.common.errors import require
from uvms_drake.control.contact.explored_front import ExploredFront


def target_depth(desired: np.ndarray, reading: np.ndarray, touched: np.ndarray, slope: np.ndarray,
                 contact_depth: np.ndarray, safe_depth: np.ndarray, ahead: float,
                 step: float = np.inf) -> np.ndarray:
    """Returns the depth to steer for [m]; see the module. Of one wall, or of arrays of them.

    Args:
        desired: F_des, along n [N].
        reading: Depths x [m] and forces F [N] of the last readings (2, ...).
        touched: Whether those were touches.
        slope: κ̂ [N/m].
        contact_depth: Where the wall begins [m]; NaN: nobody knows.
        safe_depth: x_safe [m].
        ahead: How far beyond the front the search aims [m].
        step: Largest step in contact [m].
    """
    depth = np.where(touched, reading[0], np.maximum(reading[0], contact_depth))
    force = np.where(touched, reading[1], 0.0)
    pressing = depth + np.clip((desired - force) / slope, -step, step)
    return np.where(np.isnan(pressing), safe_depth + ahead, pressing)


class PressTarget(LeafSystem):
    """Puts out the depth at which the wall should give the desired force.

    .. pydrake_system::

        name: PressTarget
        input_ports:
        - desired_force
        - reading
        - touched
        - slope
        - contact_depth
        - safe_depth
        output_ports:
        - target_depth

    - `desired_force` (1): F_des along n [N].
    - The others: those of an `ExploredFront`.
    - `target_depth` (1): see `target_depth` [m].

    It has no state.

    Args:
        ahead: How far beyond the front the search aims [m].
        step: Largest step in contact [m].
    """

    def __init__(self, ahead: float = 1.0, step: float = np.inf):
        super().__init__()
        require(0.0 < ahead < np.inf, "ahead", ahead, "positive")
        require(step > 0.0, "step", step, "positive")
        self._ahead, self._step = ahead, step
        self._desired_port = self.DeclareVectorInputPort("desired_force", 1)
        self._ports = {name: self.DeclareVectorInputPort(name, size) for name, size in (
            ("reading", 2), ("touched", 1), ("slope", 1), ("contact_depth", 1), ("safe_depth", 1))}
        self.DeclareVectorOutputPort("target_depth", 1, self._calc)

    def _calc(self, context: Context, output: BasicVector) -> None:
        reading = self._ports["reading"].Eval(context)
        others = {name: port.Eval(context)[0] for name, port in self._ports.items()
                  if name != "reading"}
        output[0] = target_depth(self._desired_port.Eval(context)[0], reading, **others,
                                 ahead=self._ahead, step=self._step)

    @staticmethod
    def AddToBuilder(builder: DiagramBuilder, front: ExploredFront, *, desired_force: OutputPort,
                     ahead: float = 1.0, step: float = np.inf, name: str = "press_target"
                     ) -> "PressTarget":
        """Adds the target and connects it.

        Args:
            builder: Where to add it.
            front: What was felt.
            desired_force: Gives F_des along n.
            ahead: How far beyond the front the search aims [m].
            step: Largest step in contact [m].
            name: Name of the system.
        """
        system = PressTarget(ahead, step)
        builder.AddNamedSystem(name, system)
        builder.Connect(desired_force, system.GetInputPort("desired_force"))
        for port in system._ports:
            builder.Connect(front.GetOutputPort(port), system.GetInputPort(port))
        return system
