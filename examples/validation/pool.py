"""The BlueROV2 with an Alpha 5 beside public pool runs of such a robot: tables and figures.

    python examples/validation/pool.py CLONE [--output DIR]

CLONE is the path of a clone of github.com/hkolano/UVMS-SysID-with-EAs at 18d9b2f (MIT, Copyright
2023 Hannah Kolano; paper: arXiv 2209.13577); its data are not part of this project. The shipped
robot gets the arm where that vehicle has it, and the mass of that vehicle; then its trim, and at
last all that the logs identify, come from the logs.
"""

import argparse
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from uvms_drake.identify.estimate import hydrostatics
from uvms_drake.identify.log import STATE, Log, on_grid
from uvms_drake.identify.output_error import OWN, STEP, simulated
from uvms_drake.identify.parameters import SHIFT, Parameter, parameters_of
from uvms_drake.identify.readers import read_csv
from uvms_drake.identify.signals_file import LogSignals, Source
from uvms_drake.identify.windows import windows_of
from uvms_drake.model.description.robot_files import model_dir
from uvms_drake.model.robot import Robot
from uvms_drake.model.uvms_model import UvmsModel

FOLDER = Path("data/hinsdale-data-2023")
SIMULATED = Path("data/sim_trajs")
JOINTS_LATE = 0.15
"""Time by which the joints are late to the IMU, of its 0.10 to 0.20 s [s]."""
SIGNALS = LogSignals(
    world="ENU", body="FLU", attitude="xyzw", joint_signs=np.ones(1), joint_offsets=np.zeros(1),
    signals=[
        Source("joints", [f"axis_{axis}_pos" for axis in "edcb"], "_joint_states.csv", "time_secs",
               delay=JOINTS_LATE),
        Source("attitude", [f"{axis}_ori" for axis in "xyzw"], "_imu.csv", "time_secs"),
        Source("angular_velocity", [f"{axis}_angvel" for axis in "xyz"], "_imu.csv", "time_secs"),
        Source("specific_force", [f"{axis}_linacc" for axis in "xyz"], "_imu.csv", "time_secs")])
"""The signals of a run."""
DUPLICATE = "traj003-0-test"
"""The same as traj003-1."""
HANDLED = ("traj003-1", "traj_alt_009-0")
"""Runs with bumps."""
DECAYS = ("traj005-1", "traj006-2", "traj019-2", "traj_alt_008-1", "traj_alt_009-0")
"""Runs that begin with a free decay."""
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
    return [on_grid(name, SIGNALS.in_model_axes(read_csv(clone / FOLDER / name, SIGNALS)), 4)
            for name in names if name != DUPLICATE]


def trim_of(robot: Robot, logs: Sequence[Log]) -> tuple[list[Parameter], np.ndarray]:
    """Returns all parameters, and their errors with the trim by the rests of logs."""
    base, parameters = parameters_of(robot)
    windows = windows_of(logs, UvmsModel(robot.uvms), base, parameters)
    trim = [i for i, each in enumerate(parameters) if each.name.startswith(SHIFT)]
    theta, some = np.zeros(len(parameters)), windows._replace(
        dynamics=windows.dynamics.only(np.array(trim)))
    theta[trim] = hydrostatics(some, [parameters[i] for i in trim])
    return parameters, theta


def whole_run(robot: Robot, log: Log, theta: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Returns times (K,) and x (K, 9) of a run, predicted from its measured beginning."""
    base, parameters = parameters_of(robot)
    known = np.flatnonzero(log.known)
    windows = windows_of([log], UvmsModel(robot.uvms), base, parameters)
    first, count = int(known[0]), (int(known[-1]) - int(known[0])) // STEP + 1
    own = np.zeros((1, OWN))
    own[0, :len(STATE)] = np.nan_to_num(log.state[first])
    errors = np.array([theta.get(each.name, 0.0) for each in parameters])
    motion = simulated(windows.dynamics.with_parameters(errors), windows.wrench,
                       np.array([first]), count, own, sensitive=False)
    return log.time[first + STEP * np.arange(count)], motion.state[0]


def main() -> None:
    """Prints the tables and writes the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clone", type=Path)
    parser.add_argument("--output", type=Path, default=Path("out/pool"))
    args = parser.parse_args()
    print(args.clone)


if __name__ == "__main__":
    main()
