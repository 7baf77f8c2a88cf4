"""A recorded log through the controller: the commands that it would have given.

The log is the folder of a `run`, or a CSV file with a header and the columns t, the 2(6+n) of the
state, and the 6 of the force, if there are any.

    python examples/your_loop/replay.py SCENARIO LOG [--period 0.02]
"""

import argparse
from pathlib import Path

import numpy as np

import uvms_drake as uv


def read_log(path: Path, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Returns times (K,), states (K, 2 size), and forces (K, 6) or None, of a log."""
    if path.is_dir():
        record = uv.load_record(path)
        state = record.signals.get("measured_state", record.state)
        return record.time, state, record.signals.get("force_measured")
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    forces = table[:, 1 + 2 * size:]
    return table[:, 0], table[:, 1:1 + 2 * size], forces if forces.shape[1] == 6 else None


def replayed(controller: uv.Controller, time: np.ndarray, states: np.ndarray,
             forces: np.ndarray | None) -> list:
    """Returns the command of each sample of a log; the first state must be one to start from."""
    controller.reset(states[0])
    return [controller.step(t, state, None if forces is None else forces[k])
            for k, (t, state) in enumerate(zip(time, states, strict=True))]


def main() -> None:
    """Replays a log, and prints the alarms and the size of the commands."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario")
    parser.add_argument("log", type=Path)
    parser.add_argument("--period", type=float, default=0.02, help="of the log [s]")
    parser.add_argument("--save", type=Path, help="CSV file for the commands: t, tau")
    arguments = parser.parse_args()
    controller = uv.Controller(uv.load_scenario(arguments.scenario), period=arguments.period)
    time, states, forces = read_log(arguments.log, controller.model.size)
    commands = replayed(controller, time, states, forces)
    said = ""
    for command in commands:
        if command.alarms and " ".join(command.alarms) != said:
            said = " ".join(command.alarms)
            print(f"t = {command.time:.2f} s, {command.mode}: {said}")
    tau = np.array([command.tau for command in commands])
    print(f"{len(commands)} samples; largest |tau| of each axis [N, N m]: "
          f"{np.array2string(np.max(np.abs(tau), axis=0), precision=3)}")
    if arguments.save:
        np.savetxt(arguments.save, np.column_stack([time, tau]), delimiter=",",
                   header="t," + ",".join(f"tau{i + 1}" for i in range(tau.shape[1])), comments="")


if __name__ == "__main__":
    main()
