"""The BlueROV2 with an Alpha 5 beside public pool runs of such a robot: tables and figures.

    python examples/validation/pool.py CLONE [--output DIR]

CLONE is the path of a clone of github.com/hkolano/UVMS-SysID-with-EAs at 18d9b2f (MIT, Copyright
2023 Hannah Kolano; paper: arXiv 2209.13577); its data are not part of this project. The shipped
robot gets the arm where that vehicle has it, and the mass of that vehicle with a volume of
15.079e-3 m³; then its trim, and at last all that the logs identify, come from the logs.
"""

import argparse
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from uvms_drake.identification.estimate import estimated, hydrostatics
from uvms_drake.identification.identify import Identification, identify
from uvms_drake.identification.log import GRID, STATE, Log, on_grid
from uvms_drake.identification.output_error import OWN, STEP, simulated
from uvms_drake.identification.parameters import SHIFT, Parameter, parameters_of
from uvms_drake.identification.readers import read_tables
from uvms_drake.identification.signals_file import LogSignals, Source
from uvms_drake.identification.windows import Windows, windows_of
from uvms_drake.identification.written import format_result, residual_sizes, validation_rms
from uvms_drake.model.description.robot_files import model_dir
from uvms_drake.model.robot import Robot
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.report.figure_style import BLUE, STYLE, VERMILION

FOLDER = Path("data/hinsdale-data-2023")
SIMULATED = Path("data/sim_trajs")
JOINT_DELAY = 0.15
"""Time by which the joints are late to the IMU, of its 0.10 to 0.20 s [s]."""
SIGNALS = LogSignals(
    world="ENU", body="FLU", attitude="xyzw", joint_signs=np.ones(1), joint_offsets=np.zeros(1),
    signals=[
        Source("joints", [f"axis_{axis}_pos" for axis in "edcb"], "_joint_states.csv", "time_secs",
               delay=JOINT_DELAY),
        Source("attitude", [f"{axis}_ori" for axis in "xyzw"], "_imu.csv", "time_secs"),
        Source("angular_velocity", [f"{axis}_angvel" for axis in "xyz"], "_imu.csv", "time_secs"),
        Source("specific_force", [f"{axis}_linacc" for axis in "xyz"], "_imu.csv", "time_secs")])
"""The signals of a run."""
DUPLICATE = "traj003-0-test"
"""The same as traj003-1."""
HANDLED = ("traj003-1", "traj_alt_009-0")
"""Runs with bumps."""
UNTOUCHED = {"traj_alt_009-0": (10.0, np.inf), "traj_alt_001-1": (0.0, 22.5),
             "traj_alt_008-2": (0.0, 16.7)}
"""Time of a run without handling, where that is not all of it [s]: 009-0 begins with bumps, the
others end with the vehicle moved by hand."""
DECAYS = ("traj005-1", "traj006-2", "traj019-2", "traj_alt_008-1", "traj_alt_009-0")
"""Runs that begin with a free decay."""
OTHER_HEAVE = ("traj012-2", "traj019-0")
"""Further runs in which the vehicle was moved up or down."""
HEAVE_STEP, HEAVE_MASS = 0.05, 34.0
"""Step [s] and mass with water of the heave alone [kg]."""
HEAVE_DRAGS = ((15.0, 80.0), (5.0, 40.0), (2.0, 80.0), (2.0, 40.0), (0.5, 40.0))
"""Linear and quadratic heave drags that are compared [N s/m, N s²/m²]."""
MOUNT = "0.25 0.110 -0.005 3.141592653589793 0 0"
"""Pose of the arm's base in the vehicle, FRD: at the starboard bow, upright [m, rad]."""
MASS, VOLUME = "14.24", "15.079e-3"
"""Mass of the vehicle [kg], and its volume without a net weight of the robot [m³]."""


def pool_robot(folder: Path) -> Robot:
    """Returns the shipped robot with arm and mass as in the pool, written into a folder."""
    robot = folder / "bluerov2_alpha5"
    shutil.copytree(model_dir("bluerov2_alpha5"), robot)
    for file, old, new in (("bluerov2_alpha5.sdf", "0.203 0 0.1317 0 0 0", MOUNT),
                           ("bluerov2_alpha5.sdf", "<mass>14.5</mass>", f"<mass>{MASS}</mass>"),
                           ("hydrodynamics.yaml", "15.349e-3", VOLUME)):
        text = (robot / file).read_text(encoding="utf-8")
        assert old in text
        (robot / file).write_text(text.replace(old, new), encoding="utf-8")
    return Robot.load(robot)


def read_runs(clone: Path) -> list[Log]:
    """Returns the distinct runs of a clone."""
    names = sorted(path.name.removesuffix("_imu.csv")
                   for path in (clone / FOLDER).glob("*_imu.csv"))
    return [on_grid(name, SIGNALS.in_model_axes(read_tables(clone / FOLDER / name, SIGNALS)), 4)
            for name in names if name != DUPLICATE]


def trim_of(windows: Windows, parameters: Sequence[Parameter], which: Sequence[bool]
            ) -> np.ndarray:
    """Returns the errors of all parameters (P,): the trim by the windows of some logs, else zero.

    Three numbers are fitted, by the rests and then by output error.
    """
    trim = np.array([i for i, each in enumerate(parameters) if each.name.startswith(SHIFT)])
    some = windows.of(np.asarray(which)[windows.log_of])._replace(
        dynamics=windows.dynamics.only(trim))
    fitted = [parameters[i] for i in trim]
    theta = np.zeros(len(parameters))
    theta[trim] = estimated(some, fitted, hydrostatics(some, fitted)).theta
    return theta


def whole_run(windows: Windows, index: int, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns the samples (K,) of a run's log, and x (K, 9) predicted from its measured start."""
    log = windows.logs[index]
    before = sum(len(each.time) for each in windows.logs[:index])
    begin, end = UNTOUCHED.get(log.name, (0.0, np.inf))
    known = np.flatnonzero(log.known & (log.time >= begin) & (log.time <= end))
    samples = np.arange(known[0], known[-1] + 1, STEP)
    own = np.zeros((1, OWN))
    own[0, :len(STATE)] = np.nan_to_num(log.state[samples[0]])
    motion = simulated(windows.dynamics.with_parameters(theta), windows.wrench,
                       np.array([before + samples[0]]), len(samples), own, sensitive=False)
    return samples, motion.state[0]


def compared(clone: Path, windows: Windows, theta: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    """Returns time, measured, the authors' and our roll and pitch (K, 2) of the 13 runs [deg].

    The authors' simulator has the commanded joints and begins 10 s before; ours has the measured
    joints, the measured initial state, and a trim of the same campaign.
    """
    out = {}
    for index, log in enumerate(windows.logs):
        file = clone / SIMULATED / f"{log.name.removeprefix('traj')}.csv"
        if file.exists():
            table = np.genfromtxt(file, delimiter=",", names=True)
            samples, x = whole_run(windows, index, theta)
            inside = log.time[samples] <= table["time_secs"][-1]
            time = log.time[samples[inside]]
            authors = [np.interp(time, table["time_secs"], sign * table[name])  # FLU
                       for name, sign in (("qs1", 1.0), ("qs2", -1.0))]
            out[log.name] = {
                "time": time, "measured": np.rad2deg(log.state[samples[inside], :2]),
                "authors": np.rad2deg(np.column_stack(authors)),
                "ours": np.rad2deg(x[inside, :2])}
    return out


def errors(runs: dict[str, dict[str, np.ndarray]], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Returns the rms and the mean of the runs' peak errors in roll and pitch (2,) [deg]."""
    off = [each[name] - each["measured"] for each in runs.values()]
    return (np.sqrt(np.nanmean(np.concatenate(off)**2, axis=0)),
            np.mean([np.nanmax(np.abs(each), axis=0) for each in off], axis=0))


def heights(clone: Path) -> np.ndarray:
    """Returns the measured rise (K, R) of the runs with sound motion capture, NaN after an end [m].

    Left out: the runs with bumps or decays, and those with jumps of more than 30 mm.
    """
    out = []
    for path in sorted((clone / FOLDER).glob("*_mocap.csv")):
        name = path.name.removesuffix("_mocap.csv")
        if name in (DUPLICATE, *HANDLED, *DECAYS, *OTHER_HEAVE):
            continue
        table = np.genfromtxt(path, delimiter=",", names=True)
        order = np.argsort(table["time_secs"])
        time, z = table["time_secs"][order], table["z_pose"][order]
        grid = np.arange(time[0] + 1.0, min(time[-1] - 1.0, time[0] + 25.0), HEAVE_STEP)
        if len(grid) * HEAVE_STEP > 8.0 and np.max(np.abs(np.diff(z))) < 0.03:
            z = np.interp(grid, time, z)
            out.append(np.pad(z - z[0], (0, 500 - len(z)), constant_values=np.nan))
    return np.array(out).T


def heave_rms(measured: np.ndarray, linear: float, quadratic: float) -> float:
    """Returns the rms of predicted less measured rise [m] with a heave drag.

    m dw/dt = B − (linear + quadratic |w|) w, one axis; the beginning (z, w) and the constant net
    force B of each run are fitted, by Gauss-Newton.
    """
    steps, runs = measured.shape

    def rise(w: np.ndarray, force: np.ndarray) -> np.ndarray:
        def rate(w: np.ndarray) -> np.ndarray:
            return (force - (linear + quadratic * np.abs(w)) * w) / HEAVE_MASS
        z = [np.zeros(runs)]
        for _ in range(steps - 1):
            middle = w + 0.5 * HEAVE_STEP * rate(w)
            z.append(z[-1] + HEAVE_STEP * middle)
            w = w + HEAVE_STEP * rate(middle)
        return np.array(z)

    w, force, z0 = np.full(runs, 0.03), np.full(runs, 0.2), np.zeros(runs)
    for _ in range(12):
        predicted = rise(w, force)
        by_w = (rise(w + 1e-4, force) - predicted) / 1e-4
        by_force = (rise(w, force + 1e-3) - predicted) / 1e-3
        for run in range(runs):
            known = np.isfinite(measured[:, run])
            jacobian = np.column_stack([np.ones(known.sum()), by_w[known, run],
                                        by_force[known, run]])
            left = measured[known, run] - predicted[known, run] - z0[run]
            step = np.linalg.lstsq(jacobian, left, rcond=None)[0]
            z0[run], w[run], force[run] = (z0[run], w[run], force[run]) + step
    return float(np.sqrt(np.nanmean((rise(w, force) + z0 - measured)**2)))


def print_identified(title: str, found: Identification) -> None:
    """Prints the parameters, the held-out error and what was not used."""
    print(f"\n{title}: {len(found.windows.start)} windows of {len(found.windows.logs)} runs")
    for each in found.results:
        if each.why != "the logs do not excite it":
            print(f"  {format_result(each)}")
    rms = validation_rms(found)
    print("  held out, rms [deg]: " + ", ".join(
        f"{name} {np.rad2deg(rms[name]):.2f}" for name in STATE[:2]))
    sizes = residual_sizes(found)[3:]
    print("  residual, 99.9 % [rad/s2]: " + ", ".join(f"{each:.3f}" for each in sizes))
    for line in found.refused:
        print(f"  not used: {line}")


def inertia_of(robot: Robot, found: Identification) -> str:
    """Returns roll and pitch inertia of the robot with water, about the vehicle's origin."""
    dynamics = found.windows.dynamics.with_parameters(found.estimate.theta)
    total = np.mean(dynamics.composite.inertia, axis=0)
    half = {each.parameter.name: each.half * each.parameter.value for each in found.identified}
    return ", ".join(f"{name} {total[i, i]:.3f} ± " + (
        f"{half[key]:.3f}" if (key := f"vehicle.added_mass.{name}") in half else "(not identified)")
        for i, name in ((3, "roll"), (4, "pitch")))


def comparison_figure(runs: dict[str, dict[str, np.ndarray]]) -> Figure:
    """Returns measured roll and pitch of some of the 13 runs, the authors' and ours."""
    chosen = list(runs)[:6]
    figure = Figure(figsize=(7.2, 3.0), layout="constrained")
    for column, name in zip(figure.subplots(2, len(chosen), sharex="col").T, chosen, strict=True):
        run = runs[name]
        for k, ax in enumerate(column):
            for key, color, label in (("measured", "k", "measured"),
                                      ("authors", VERMILION, "the authors' simulator"),
                                      ("ours", BLUE, "this model")):
                ax.plot(run["time"], run[key][:, k], color=color, label=label)
        column[0].set_title(name)
        column[1].set_xlabel("time [s]")
    figure.legend(*column[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    figure.axes[0].set_ylabel("roll [deg]")
    figure.axes[len(chosen)].set_ylabel("pitch [deg]")
    return figure


def main(argv: Sequence[str] | None = None) -> dict[str, np.ndarray]:
    """Prints the tables, writes the figures, and returns the errors [deg]."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clone", type=Path)
    parser.add_argument("--output", type=Path, default=Path("out/pool"))
    parser.add_argument("--compare-only", action="store_true", help="the 13 runs alone")
    args = parser.parse_args(argv)
    logs, out = read_runs(args.clone), {}
    print(f"{len(logs)} runs, {GRID * sum(len(log.time) for log in logs):.0f} s")
    with tempfile.TemporaryDirectory() as folder:
        robot = pool_robot(Path(folder))
        base, parameters = parameters_of(robot)
        windows = windows_of(logs, UvmsModel(robot.uvms), base, parameters)
        sound = [log.name not in HANDLED for log in logs]
        session = ["_alt_" in log.name for log in logs]
        print("\n13 runs: rms roll, pitch; mean of the peaks [deg]")
        for title, name, source in (
                ("the authors' simulator", "authors", session),
                ("this model, trim of the same session", "ours", session),
                ("this model, trim of the other session", "ours", np.logical_not(session))):
            theta = trim_of(windows, parameters, np.logical_and(source, sound))
            runs = compared(args.clone, windows, theta)
            rms, peak = errors(runs, name)
            print(f"  {title:40s} {rms[0]:.2f} {rms[1]:.2f}   {peak[0]:.2f} {peak[1]:.2f}")
            out[title] = rms
        if not args.compare_only:
            rise = heights(args.clone)
            print(f"\nrise of {rise.shape[1]} runs, of heave alone: rms [mm] by drag")
            for drag in HEAVE_DRAGS:
                print(f"  {drag[0]:g} + {drag[1]:g} |w|: {1e3 * heave_rms(rise, *drag):.1f}")
            for title, some in (("all runs", logs), ("slow runs, without the decays", [
                    log for log in logs if log.name not in DECAYS])):
                found = identify(robot, some)
                print_identified(title, found)
                print(f"  inertia with water [kg m2]: {inertia_of(robot, found)}")
        args.output.mkdir(parents=True, exist_ok=True)
        with matplotlib.rc_context(STYLE):
            comparison_figure(runs).savefig(args.output / "pool_runs.png", dpi=150)
    return out


if __name__ == "__main__":
    main()
