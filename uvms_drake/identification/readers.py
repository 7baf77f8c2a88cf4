"""Readers of logs: each returns samples of the signals, which `log.on_grid` puts on one grid."""

import csv
import hashlib
import zipfile
from pathlib import Path

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.identification.log import Log, Samples, on_grid
from uvms_drake.identification.recordings import Table, is_recording, recorded_tables
from uvms_drake.identification.signals_file import TIMES, UNITS, LogSignals
from uvms_drake.plant.waves import UnknownFlow
from uvms_drake.station.record import SCENARIO_FILE
from uvms_drake.station.scenario.scenario import load_scenario

OWN_FILE = "log.npz"
"""Log of a run of this program."""
HEIGHT = 0.3
"""Largest height above the surface that the median of a depth may have [m]."""
EXERTED = ("exerted", "tau")
"""Its generalised forces, the best first."""


def read_log(path: Path, joints: int, signals: LogSignals | None) -> Log:
    """Returns a log, by the kind of its file.

    Args:
        path: Folder or `log.npz` of a run of this program, a recording (see `recordings`), or CSV:
            the path, to which `signals` adds the ends of its files, as `/imu.csv` to a folder.
        joints: Number of joints of the robot.
        signals: Where the signals are; of a run of this program nothing.

    Raises:
        InvalidParameter: Not such a file, without the signals that are needed, or of a run in
            water that moves.
        ScenarioError: The scenario in the folder of a run cannot be read.
    """
    own = path / OWN_FILE if (path / OWN_FILE).is_file() else path
    if own.suffix == ".npz" and not is_recording(path):
        found = read_own(own, joints)
        if path.is_dir():
            _require_still_water(path)
        return on_grid(str(path), found, joints)
    require(signals is not None, "--signals", None,
            f"the file that says where the signals of {path} are")
    assert signals is not None
    found = read_tables(path, signals)
    for needed in ["attitude"] + ["joints"] * bool(joints):
        require(needed in found, f"{path}: signals", ", ".join(found) or "none",
                f"{needed} among them")
    require(not joints or found["joints"][1].shape[1] == joints, f"{path}: joints",
            found.get("joints", (0, np.zeros((0, 0))))[1].shape[1], f"{joints} columns")
    if "depth" in found:
        depths = found["depth"][1]
        usual = float(np.median(depths[np.isfinite(depths)])) if np.isfinite(depths).any() else 0.0
        require(not usual <= -HEIGHT, f"{path}: depth", usual, "positive down, in m from the "
                "surface: an altitude, as ArduSub's, is negative under water")
    armed = found.pop("armed", None)
    require(armed is None or "wrench" in found or not np.any(armed[1]), f"{path}: armed", 1,
            "0, or with the wrench of the thrusters: they are armed without commands")
    return on_grid(str(path), signals.in_model_axes(found), joints)


def _require_still_water(run: Path) -> None:
    """Raises for the folder of a run with a current or waves, which no parameter stands for."""
    scenario = load_scenario(str(run / SCENARIO_FILE))
    current = float(np.linalg.norm(scenario.current))
    moving = [f"a current of {current:.3g} m/s"] * (current > 0.0) + ["waves"] * any(
        wave.amplitude for wave in scenario.waves) + ["an unknown flow"] * any(
        isinstance(fault, UnknownFlow) for fault in scenario.faults)
    require(not moving, "LOG", str(run),
            f"in still water: the run has {' and '.join(moving)}")


def read_own(path: Path, joints: int) -> dict[str, Samples]:
    """Returns the signals of a run of this program, in the model's axes."""
    try:
        with np.load(path) as log:
            arrays = {name: log[name] for name in ("time", "state", "force", *EXERTED)
                      if name in log.files}
            time, x = arrays["time"], arrays["state"]
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        raise InvalidParameter("LOG", str(path), "a log of a run") from None
    size = 6 + joints
    require(x.ndim == 2 and x.shape[1] == 2 * size, "LOG", str(path),
            f"a log of a robot with {joints} joints")
    wrench = next((arrays[name] for name in EXERTED if name in arrays), None)
    require(wrench is not None and "force" in arrays, "LOG", str(path),
            f"a log of a run with force, and {' or '.join(EXERTED)}")
    assert wrench is not None
    return {"joints": (time, x[:, 6:size]), "attitude": (time, x[:, 3:6]), "depth": (
        time, x[:, 2:3]), "velocity": (time, x[:, size:size + 3]), "angular_velocity": (
        time, x[:, size + 3:size + 6]), "wrench": (time, wrench[:, :6]),
        "force": (time, arrays["force"][:, :3])}


def read_tables(path: Path, signals: LogSignals) -> dict[str, Samples]:
    """Returns the signals of a recording or of CSV files, in SI units and the declared axes."""
    ends = sorted({each.file for each in signals.signals})
    tables = recorded_tables(path, ends) if is_recording(path) else {
        end: _table(Path(f"{path}{end}"), {
            column for each in signals.signals if each.file == end
            for column in (each.time, *each.columns)}) for end in ends}
    found = dict[str, Samples]()
    for each in signals.signals:
        file, table = f"{path}{each.file}", tables[each.file]
        for column in (each.time, *each.columns):
            require(column in table, f"{file}: column", column,
                    f"one of {', '.join(table)}")
        time = table[each.time] * TIMES[each.time_unit] - each.delay
        values = np.column_stack([table[column] for column in each.columns]) * UNITS[each.unit]
        found[each.signal] = _increasing(time, values, f"{file}: {each.time}")
    return found


def _table(path: Path, wanted: set[str]) -> Table:
    """Returns the columns of a CSV file; those that are not wanted may have text, and are NaN."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            header, *rows = csv.reader(file)
        cells = [row for row in rows if row]
        require(bool(cells) and all(len(row) == len(header) for row in cells), "LOG", str(path),
                "a table with as many numbers in each row as in its header")
        return {name: np.array([float(cell or "nan") if name in wanted else np.nan
                                for cell in column])
                for name, column in zip(header, zip(*cells, strict=True), strict=True)}
    except (OSError, ValueError, csv.Error) as error:
        raise InvalidParameter("LOG", str(path), f"a CSV file of numbers ({error})") from None


def _increasing(time: np.ndarray, values: np.ndarray, key: str) -> Samples:
    """Returns the samples of increasing times; raises where most of them are not."""
    known = np.isfinite(time)
    time, values = time[known], values[known]
    keep = np.append(True, time[1:] > np.maximum.accumulate(time)[:-1]) if len(time) else known
    require(len(time) > 1 and np.mean(keep) > 0.5, key, "times that do not increase",
            "increasing times")
    return time[keep], values[keep]


def digest(path: Path, signals: LogSignals | None) -> str:
    """Returns the SHA-256 of a log's files."""
    found = hashlib.sha256()
    ends = [""] if signals is None else sorted({each.file for each in signals.signals}) or [""]
    for file in ([path] if path.suffix == ".npz" or (
            path.is_file() and is_recording(path)) else sorted(path.glob("*.*"))
                 if is_recording(path) else [path / OWN_FILE] if (path / OWN_FILE).is_file() else
                 [Path(f"{path}{end}") for end in ends]):
        found.update(file.read_bytes())
    return found.hexdigest()
