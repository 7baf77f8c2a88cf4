"""The record of a run: its scenario and its signals, as plain arrays."""

import zlib
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np

from uvms_drake.common.errors import InvalidParameter, ScenarioError
from uvms_drake.control.feedback.tube_monitor import TUBE_REPORT
from uvms_drake.control.laws.law import FIELDS
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.description.robot_files import shipped_robots
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import Scenario, dump_scenario, load_scenario
from uvms_drake.station.signals import SIGNALS, columns_of

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped,import-not-found,unused-ignore]

SCENARIO_FILE = "scenario.yaml"
LOG_FILE = "log.npz"
TIMING_FILE = "timing.npz"


@dataclass(frozen=True)
class Record:
    """The signals of a run: T logged samples, K samples of the nominal MPC, n joints.

    Every array, also of `signals`, is in `log.npz` under its name, except the two wall times, which
    differ from run to run, the text of a failure and the declared duration: they are in
    `timing.npz`. A bar marks the nominal system.
    """

    scenario: Scenario
    time: np.ndarray
    """Logged instants (T,) [s]."""
    state: np.ndarray
    """State (𝔮, ζ) (T, 2(6+n)) [m, rad, m/s, rad/s]."""
    nominal_state: np.ndarray
    """Nominal state (𝔮̄, ζ̄) (T, 2(6+n)) [m, rad, m/s, rad/s]."""
    chi: np.ndarray
    """Pose χ of the end-effector in Σ_I (T, 6) [m, rad]."""
    chi_nominal: np.ndarray
    """Nominal pose χ̄ (T, 6) [m, rad]."""
    chi_des: np.ndarray
    """Desired pose χ_des of the last 𝔉_des (6,) [m, rad]."""
    nominal_input: np.ndarray
    """Nominal input ū (T, 6+n) [m/s², rad/s²]."""
    u: np.ndarray
    """Command 𝔲 (T, 6+n) [m/s², rad/s²]."""
    tau: np.ndarray
    """Generalised force τ = M𝔲 (T, 6+n) [N, N m]."""
    state_lost: np.ndarray
    """1 where the measured state was not finite and the command was the plan's own, else 0 (T,)."""
    input_limited: np.ndarray
    """1 where a limit cut the command, else 0 (T,)."""
    force: np.ndarray
    """Wrench 𝔉 exerted on the surface (T, 6) [N, N m]."""
    desired_force: np.ndarray
    """Wrench 𝔉_des that the nominal MPC plans for (T, 6) [N, N m]."""
    penetration: np.ndarray
    """Depth of the end-effector in the surface (T,) [m]."""
    disturbance: np.ndarray
    """Disturbance d (T, 6+n) [m/s², rad/s²]."""
    acceleration: np.ndarray
    """Acceleration ζ̇ (T, 6+n) [m/s², rad/s²]."""
    effective_disturbance: np.ndarray
    """Residual ζ̇ − f(𝔮, ζ) − 𝔲 (T, 6+n) [m/s², rad/s²] with the controller's f and the sent 𝔲: d
    and all model errors, without the effect of sample and hold."""
    joint_lower: np.ndarray
    """Smallest joint angles allowed (n,) [rad]: the robot's, or the scenario's if narrower."""
    joint_upper: np.ndarray
    """Largest joint angles allowed (n,) [rad]."""
    mpc_time: np.ndarray
    """Instants at which the MPC planned (K,) [s]."""
    mpc_status: np.ndarray
    """Outcomes of the samples (K,): 0 solved; 1 the solver failed, or 2 missed the deadline, and
    the last plan was continued; 3 the sample was dropped and the last plan was continued; 4 the
    last plan was better than the new one and was kept."""
    mpc_cost: np.ndarray
    """Objectives of the plans (K,)."""
    mpc_terminal_slack: np.ndarray
    """Distance of the end of the plan to the terminal set, in ‖ξ‖_P (K,)."""
    mpc_violation: np.ndarray
    """Largest violation of a limit by the plan, in the limit's own unit (K,)."""
    mpc_iterations: np.ndarray
    """Number of convex programs solved (K,)."""
    mpc_refused: np.ndarray
    """1 while a new desired force is refused (K,)."""
    mpc_rows: np.ndarray
    """Number of active rows of limits in the last convex program (K,)."""
    step_seconds: np.ndarray
    """Wall time of each MPC step (K,) [s]."""
    wall_time_s: float
    """Wall time of the simulation [s]."""
    certified: np.ndarray
    """Whether the tube is that of a certificate that holds; it is declared otherwise."""
    tube_report: np.ndarray
    """Report of the `TubeMonitor` at the end, see `TUBE_REPORT` (19,)."""
    tube_deviation: np.ndarray
    """Norms of the deviation, see `laws.law.FIELDS` (T, 6)."""
    tube_bound: np.ndarray
    """Bounds of the norms along the run (T, 6)."""
    failure: np.ndarray = field(default_factory=lambda: np.array(""))
    """Time and cause, as text, of the exception that ended the run early; empty: none did."""
    declared_duration: np.ndarray = field(default_factory=lambda: np.array(np.nan))
    """Duration of the scenario that was run [s], of which the record's may be a part; NaN: its."""
    signals: dict[str, np.ndarray] = field(default_factory=dict)
    """Signals of the parts of sensing and actuation (T, size), by name."""

    @cached_property
    def model(self) -> ContactModel:
        """The controller's model of robot and surface; loaded once, on first use."""
        return load_model(self.scenario)

    @property
    def trip(self) -> float:
        """Time at which the supervisor first left the plan and retreated [s]; inf: it has not."""
        return float(self.signals["safety"][~self.followed][0, 2]) if not np.all(
            self.followed) else np.inf

    @property
    def followed(self) -> np.ndarray:
        """Whether the plan is followed (T,): while the supervisor does not retreat."""
        if "safety" not in self.signals:
            return np.ones(len(self.time), dtype=bool)
        followed: np.ndarray = self.signals["safety"][:, 0] == 0.0
        return followed

    @property
    def num_joints(self) -> int:
        """Number n of joints."""
        return len(self.joint_lower)

    @property
    def config(self) -> np.ndarray:
        """Configuration 𝔮 (T, 6+n) [m, rad]."""
        return self.state[:, : 6 + self.num_joints]

    @property
    def zeta(self) -> np.ndarray:
        """Velocity ζ = (ν₁, ν₂, q̇) (T, 6+n) [m/s, rad/s]."""
        return self.state[:, 6 + self.num_joints:]

    @property
    def nominal_config(self) -> np.ndarray:
        """Nominal configuration 𝔮̄ (T, 6+n) [m, rad]."""
        return self.nominal_state[:, : 6 + self.num_joints]

    @property
    def nominal_zeta(self) -> np.ndarray:
        """Nominal velocity ζ̄ (T, 6+n) [m/s, rad/s]."""
        return self.nominal_state[:, 6 + self.num_joints:]

    def columns(self) -> dict[str, np.ndarray]:
        """Returns all logged signals as columns (T,), in SI units, named as in `log.csv`.

        The first is `time_s`. Those of the MPC have instants of their own and are not among them.
        """
        arrays = {name: getattr(self, name) for name in SIGNALS if hasattr(self, name)}
        arrays |= self.signals
        ordered = {name: arrays[name] for name in SIGNALS if name in arrays}
        return {"time_s": self.time} | columns_of(
            ordered | arrays, self.model.slides.tolist())

    def to_pandas(self) -> "pandas.DataFrame":
        """Returns `columns` as a table with the time as its index; it needs the package pandas."""
        import pandas

        return pandas.DataFrame(self.columns()).set_index("time_s")

    def deviation_of(self, part: str) -> np.ndarray:
        """Returns the deviation (T,) of one of `laws.law.FIELDS`."""
        return self.tube_deviation[:, FIELDS.index(part)]

    def ratio_of(self, part: str) -> float:
        """Returns the largest deviation over its set-wise bound, of a part but `task` and `r`."""
        return float(self.tube_report[TUBE_REPORT.index(f"worst_set_{part}")])

    def summary(self) -> dict[str, Any]:
        """Returns the summary of the run, as in `summary.json`; see `report.summary.summarise`."""
        import uvms_drake as uv  # The report stands above: only its public name is known here.

        return uv.summarise(self)

    def save(self, folder: str | Path) -> list[Path]:
        """Writes the files that `load_record` reads into a folder and returns their paths."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        return save_record(self, folder)

    def figures(self, folder: str | Path) -> list[Path]:
        """Writes the figures of the run as PNG files into a folder and returns their paths."""
        import uvms_drake as uv

        return uv.make_figures(self, folder)

    def bound_of(self, part: str) -> np.ndarray:
        """Returns the trajectory-wise bound (T,) of one of `FIELDS`; inf if there is none."""
        return self.tube_bound[:, FIELDS.index(part)]


_TIMING = ("step_seconds", "wall_time_s", "failure", "declared_duration")
_LOGGED = tuple(f.name for f in fields(Record) if f.name not in ("scenario", "signals", *_TIMING))


def from_anywhere(scenario: Scenario) -> Scenario:
    """Returns the scenario with the absolute path of its robot, unless that is shipped."""
    model = scenario.model
    return replace(scenario, model=model if model in shipped_robots() else str(
        Path(model).resolve()))


def save_record(record: Record, folder: Path) -> list[Path]:
    """Writes `scenario.yaml`, `log.npz` and `timing.npz` into a folder; returns their paths.

    The scenario can be run from anywhere: the path of a robot that is not shipped is absolute.
    The same arrays give the same `log.npz`, byte for byte: NumPy stores no time of writing.
    """
    scenario, log, timing = (folder / name for name in (SCENARIO_FILE, LOG_FILE, TIMING_FILE))
    scenario.write_text(dump_scenario(from_anywhere(record.scenario)), encoding="utf-8")
    logged = {name: getattr(record, name) for name in _LOGGED}
    np.savez(log, **{**logged, **record.signals})
    np.savez(timing, **{name: getattr(record, name) for name in _TIMING})
    return [scenario, log, timing]


def load_record(folder: str | Path) -> Record:
    """Returns the record that a run or `Record.save` has written into a folder.

    Raises:
        InvalidParameter: Not such a folder.
    """
    folder = Path(folder)
    try:
        with np.load(folder / LOG_FILE) as log, np.load(folder / TIMING_FILE) as timing:
            arrays = {name: log[name] for name in _LOGGED}
            signals = {name: log[name] for name in log.files if name not in _LOGGED}
            return Record(scenario=load_scenario(str(folder / SCENARIO_FILE)),
                          step_seconds=timing["step_seconds"], failure=timing["failure"],
                          wall_time_s=float(timing["wall_time_s"]), signals=signals,
                          declared_duration=timing["declared_duration"]
                          if "declared_duration" in timing else np.array(np.nan), **arrays)
    except OSError as error:
        name = Path(error.filename).name if error.filename else str(folder)
        raise unusable_folder(folder, f"{name}: {error.strerror or error}") from None
    except ScenarioError as error:
        raise unusable_folder(folder, str(error)) from None
    except KeyError as error:
        raise unusable_folder(
            folder, f"its {LOG_FILE} is of another version: {error.args[0]}") from None
    except (ValueError, EOFError, BadZipFile, zlib.error):
        raise unusable_folder(folder, f"its {LOG_FILE} or {TIMING_FILE} is damaged") from None


def unusable_folder(folder: Path, why: str) -> InvalidParameter:
    """Returns the error of a folder that has no record, or not all of it."""
    return InvalidParameter(
        "DIR", str(folder), f"a folder that 'run' or Record.save has written ({why})")
