"""The signals of a station: components, units, frames and sources, under one name everywhere.

The name is that of the output port, of the array in `log.npz` and of the columns of `log.csv`. The
table `signals.md` is generated from here.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from uvms_drake.control.laws.law import FIELDS
from uvms_drake.control.supervisor.detections import CAUSES
from uvms_drake.model.signals.sensor_actuator import SAFETY

Component = tuple[str, str]
Components = tuple[Component | str, ...]

POSITION = (("x", "m"), ("y", "m"), ("z", "m"))
POSE = (*POSITION, ("roll", "rad"), ("pitch", "rad"), ("yaw", "rad"))
TWIST = (("u", "m/s"), ("v", "m/s"), ("w", "m/s"), ("p", "rad/s"), ("q", "rad/s"), ("r", "rad/s"))
"""Components of ν by their names after SNAME."""
ACCELERATION = tuple((name, f"{unit}²") for name, unit in TWIST)
WRENCH = (("x", "N"), ("y", "N"), ("z", "N"), ("mx", "N m"), ("my", "N m"), ("mz", "N m"))
BODY_WRENCH = (("X", "N"), ("Y", "N"), ("Z", "N"), ("K", "N m"), ("M", "N m"), ("N", "N m"))
"""Components of τ on the vehicle by their names after SNAME."""
FIELD_UNITS = dict(zip(FIELDS, ("m, rad", "m", "rad", "rad", "m/s, rad/s", "m/s, rad/s"),
                       strict=True))
IN_NAMES = {"m": "m", "rad": "rad", "s": "s", "N": "N", "m/s": "m_s", "rad/s": "rad_s",
            "m/s²": "m_s2", "rad/s²": "rad_s2", "N m": "Nm", "N/m": "N_m", "m, rad": "m_rad",
            "m/s, rad/s": "m_s_rad_s", "-": ""}
"""Units as in the names of columns."""
JOINTS, SPEEDS, RATES, TORQUES = "joints", "speeds", "rates", "torques"
"""Blocks with a component for each joint."""
THRUSTERS, DRIVERS = "thrusters", "drivers"
"""Blocks with a component for each thruster: forces, and commands of the drivers."""
BLOCKS = {JOINTS: ("q{}", "rad", "m"), SPEEDS: ("qdot{}", "rad/s", "m/s"),
          RATES: ("qddot{}", "rad/s²", "m/s²"), TORQUES: ("q{}", "N m", "N"),
          THRUSTERS: ("t{}", "N", "N"), DRIVERS: ("t{}", "-", "-")}
"""Name of a component, and its unit for a joint that turns and for one that slides."""
FLAG = (("", "-"),)

class Signal(NamedTuple):
    """Description of a signal."""

    components: Components
    """Name and unit of each component; a word of `BLOCKS` stands for one a joint or thruster."""
    frame: str
    """Axes that it is in; empty without any."""
    source: str
    """System or part that it comes from, and its meaning."""


BODY = "Σ_B"
STATE = Signal((*POSE, JOINTS, *TWIST, SPEEDS), "Σ_I; ν Σ_B", "plant: (𝔮, ζ)")
INPUT: Components = (*ACCELERATION, RATES)
SIGNALS: dict[str, Signal] = {
    "state": STATE,
    "measured_state": STATE._replace(source="navigation: measured (𝔮, ζ)"),
    "nominal_state": STATE._replace(source="nominal MPC: (𝔮̄, ζ̄)"),
    "chi": Signal(POSE, "Σ_I", "plant: pose χ of the end-effector"),
    "chi_nominal": Signal(POSE, "Σ_I", "nominal MPC: pose χ̄; derived, no port"),
    "u": Signal(INPUT, BODY, "ancillary law: command 𝔲"),
    "nominal_input": Signal(INPUT, BODY, "nominal MPC: ū"),
    "tau": Signal((*BODY_WRENCH, TORQUES), BODY, "ancillary law: command τ = M𝔲"),
    "zoh_command": Signal((*BODY_WRENCH, TORQUES), BODY, "actuation: τ under the hold"),
    "exerted": Signal((*BODY_WRENCH, TORQUES), BODY, "actuation: τ on the robot"),
    "acceleration": Signal(INPUT, BODY, "plant: ζ̇"),
    "disturbance": Signal(INPUT, BODY, "disturbance: d"),
    "effective_disturbance": Signal(
        INPUT, BODY, "residual ζ̇ − f(𝔮, ζ) − 𝔲: d and all model errors; derived, no port"),
    "force": Signal(WRENCH, "Σ_I", "plant: 𝔉 on the surface"),
    "desired_force": Signal(WRENCH, "Σ_I", "nominal MPC: 𝔉_des of the plan"),
    "force_raw": Signal(WRENCH, "Σ_S (sensor)", "force sensor: its own wrench"),
    "force_measured": Signal(WRENCH, "Σ_I", "force sensor: 𝔉_s; nan in a gap"),
    "force_last_valid": Signal(WRENCH, "Σ_I", "force sensor: last valid 𝔉_s, zero while released"),
    "force_filtered": Signal(WRENCH, "Σ_I", "tangential filter: input of the law"),
    "penetration": Signal((("", "m"),), "", "plant: depth of the end-effector in the surface"),
    "target": Signal(POSITION, "Σ_I", "press target: desired position of the end-effector"),
    "unclipped_target": Signal(POSITION, "Σ_I", "the same, whatever the largest depth"),
    "target_of_reading": Signal(POSITION, "Σ_I", "the same, by the last reading alone"),
    "safe_depth": Signal((("", "m"),), "", "contact estimator: largest admissible depth"),
    "contact_depth": Signal((("", "m"),), "", "contact estimator: depth of the undeformed wall"),
    "stiffness_estimate": Signal((("", "N/m"),), "", "stiffness estimate: mean of the filter"),
    "stiffness_std": Signal((("", "N/m"),), "", "stiffness estimate: standard deviation"),
    "stiffness_used": Signal((("", "N/m"),), "", "stiffness estimate: value that the target uses"),
    "touched": Signal(FLAG, "", "contact estimator: 1 if the last reading was a contact"),
    "force_status": Signal(
        FLAG, "", "fault detector: 0 valid; no reading: 1 frozen, 2 saturated, 3 missing"),
    "force_lost": Signal(FLAG, "", "contact estimator: 1 while the force sensor counts as failed"),
    "state_lost": Signal(FLAG, "", "ancillary law: 1 while the measured state is not finite"),
    "input_limited": Signal(FLAG, "", "ancillary law: 1 while a limit cuts the command"),
    "input_filtered": Signal(FLAG, "", "ancillary law: 1 while the filter of the joints cuts"),
    "fix_age": Signal((("", "s"),), "", "navigation: age of the last fix of the DVL"),
    "safety": Signal(tuple(zip(SAFETY, ("-", "-", "s", "N/m", "-"), strict=True)), "",
                     "supervisor: mode, index of the cause; time and stiffness at the trip; "
                     "thruster without power"),
    "safety_ratio": Signal(tuple((name, "-") for name in CAUSES), "",
                           "supervisor: largest value over its threshold so far, of each cause"),
    "mission_place": Signal(POSITION, "Σ_I", "mission: place that is due"),
    "mission_force": Signal((("", "N"),), "", "mission: force that is due"),
    "mission_progress": Signal(
        tuple((name, "-") for name in ("step", "outcome", "reason", "failures", "tries")), "",
        "mission: its state"),
    "thruster_command": Signal(
        (DRIVERS,), "", "allocation: command of each thruster in its driver's unit (µs or −1…1)"),
    "thruster_force": Signal((THRUSTERS,), "", "thrusters: force of each"),
    "vehicle_wrench": Signal(BODY_WRENCH, BODY, "thrusters: their wrench, by the model"),
    "wrench_shortfall": Signal(BODY_WRENCH, BODY, "allocation: commanded wrench less the exerted"),
    "payload": Signal(WRENCH, "Σ_E", "plant: wrench on the payload"),
    "payload_at_rest": Signal(WRENCH, "Σ_E", "plant: static part of it"),
    "tube_deviation": Signal(tuple(FIELD_UNITS.items()), "",
                             "tube monitor: norms of the deviation from the nominal motion"),
    "tube_bound": Signal(tuple(FIELD_UNITS.items()), "", "tube monitor: bounds along the run"),
}
"""Every signal of a station that is logged each `log_period`."""
MPC_SIGNALS = {
    "mpc_time": Signal((("", "s"),), "", "nominal MPC: instants of its samples"),
    "mpc_status": Signal(FLAG, "", "nominal MPC: outcome of a sample"),
    "mpc_cost": Signal(FLAG, "", "nominal MPC: objective of the plan"),
    "mpc_terminal_slack": Signal(FLAG, "", "nominal MPC: distance to the terminal set, in ‖ξ‖_P"),
    "mpc_violation": Signal(FLAG, "", "nominal MPC: largest violation, in the limit's unit"),
    "mpc_iterations": Signal(FLAG, "", "nominal MPC: convex programs solved"),
    "mpc_refused": Signal(FLAG, "", "nominal MPC: 1 while a desired force is refused"),
    "mpc_rows": Signal(FLAG, "", "nominal MPC: active rows of limits"),
    "step_seconds": Signal((("", "s"),), "", "nominal MPC: wall time of a step; in timing.npz"),
}
"""Signals of the samples of the nominal MPC, in `log.npz` alone."""


def column_names(name: str, size: int, slides: Sequence[bool]) -> list[str]:
    """Returns the columns of a signal in `log.csv`: name, component and unit.

    Those of a signal of a user's own part are numbered.

    Args:
        name: Name of the signal.
        size: Number of its components.
        slides: Whether each joint slides.
    """
    known = SIGNALS.get(name)
    if known is None:
        return [name] if size == 1 else [f"{name}/{i}" for i in range(size)]
    components, names = known.components, []
    for component in components:
        names += ([component] if isinstance(component, tuple)
                  else _block(component, size - len(components) + 1, slides))
    assert len(names) == size, f"{name} has {size} components, not {names}"
    return [f"{name}/{part}_{IN_NAMES[unit]}".replace("/_", "_").rstrip("_/")
            for part, unit in names]


def _block(word: str, size: int, slides: Sequence[bool]) -> list[Component]:
    """Returns the components of a block of joints or thrusters."""
    name, turning, sliding = BLOCKS[word]
    of_thrusters = word in (THRUSTERS, DRIVERS)
    count = size if of_thrusters else len(slides)
    return [(name.format(i + 1), sliding if not of_thrusters and slides[i] else turning)
            for i in range(count)]


def columns_of(signals: Mapping[str, np.ndarray], slides: Sequence[bool]
               ) -> dict[str, np.ndarray]:
    """Returns the columns (T,) of signals (T, size) or (T,) by their names with units."""
    columns: dict[str, np.ndarray] = {}
    for name, values in signals.items():
        table = values.reshape(len(values), -1)
        if table.shape[1]:
            columns.update(zip(column_names(name, table.shape[1], slides), table.T,
                               strict=True))
    return columns


def format_signals() -> str:
    """Returns the table of all signals as Markdown, for `signals.md`."""
    lines = [
        "# Signals", "",
        "Generated by `uvms-drake keys --signals`. A name is that of the station's output port, of",
        "the array in `log.npz` and, with component and unit as in `state/x_m`, of the columns of",
        "`log.csv` and the messages of `log.mcap`; n joints, m thrusters. Sizes, and the scenarios",
        "with each: [ports](README.md).", "",
        "| signal | components | unit | frame | source |", "|---|---|---|---|---|"]
    for name, signal in {**SIGNALS, **MPC_SIGNALS}.items():
        lines.append(f"| `{name}` | {_parts(signal)} | {_units(signal)} | {signal.frame or '–'} | "
                     f"{signal.source} |")
    return "\n".join(lines)


def _parts(signal: Signal) -> str:
    words = []
    for component in signal.components:
        if isinstance(component, tuple):
            words.append(component[0] or "–")
        else:
            last = "m" if component in (THRUSTERS, DRIVERS) else "n"
            name = BLOCKS[component][0]
            words.append(f"{name.format(1)}…{name.format(last)}")
    return ", ".join(words)


def _units(signal: Signal) -> str:
    units = [component[1] if isinstance(component, tuple) else BLOCKS[component][1]
             for component in signal.components]
    return "; ".join(dict.fromkeys(units))
