"""Table and figure of the presses in MuJoCo beside those in Drake, on three walls for each robot.

Run `python examples/your_loop/mujoco_beside_drake.py --rows FOLDER`: runs that the folder has as
files are not computed again. It writes `examples/results/mujoco.md` and its figure.
"""

import argparse
import json
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from in_mujoco import PERIODS, SCENARIOS, press

import uvms_drake as uv

RESULTS = Path(__file__).parent.parent / "results"
CASES = {"girona500_arm5e": ((0.5, 0.0, 11.0), (1.0, 0.05, 14.0), (2.0, 0.0, 14.0)),
         "bluerov2_alpha5": ((0.5, 0.0, 19.0), (1.0, 0.05, 21.0), (2.0, 0.0, 19.0))}
"""For each robot factor of the stiffness, shift [m] and duration [s]."""


def in_drake(robot: str, stiffer: float, off: float, duration: float) -> dict[str, np.ndarray]:
    """Returns time, force and state of the same press with our plant, sampled as the loop is."""
    name = SCENARIOS[robot]
    scenario = uv.load_scenario(name, [
        f"duration={duration}", "disturbance.bound=0",
        f"actuation=[!SampledCommand {{period: {PERIODS[name]}, delay: 0.0}}]"])
    scenario.surface.law.stiffness *= stiffer
    scenario.surface.geometry.point = scenario.surface.geometry.point + off * np.asarray(
        scenario.contact.direction)
    record = uv.simulate(scenario)
    return {"time": record.time, "force": record.force[:, :3] @ scenario.contact.direction,
            "state": record.state}


def kept(folder: Path, name: str, compute) -> dict[str, np.ndarray]:
    """Returns the rows of a file, which is computed if it is not there."""
    path = folder / f"{name}.json"
    if not path.exists():
        rows = {key: np.asarray(value).tolist() for key, value in compute().items()}
        path.write_text(json.dumps(rows))
    return {key: np.array(value) for key, value in json.loads(path.read_text()).items()}


def over_end(run: dict[str, np.ndarray]) -> str:
    """Returns mean, least and largest force over the last 3 s, and the largest of all."""
    late = run["force"][run["time"] > run["time"][-1] - 3.0]
    return (f"{np.mean(late):.2f} ({np.min(late):.2f} to {np.max(late):.2f}), "
            f"{np.max(run['force']):.2f}")


def main() -> None:
    """Writes table and figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", type=Path, required=True, help="folder of the runs")
    parser.add_argument("--kept-only", action="store_true",
                        help="leave out runs in Drake that the folder does not have")
    arguments = parser.parse_args()
    folder = arguments.rows
    folder.mkdir(exist_ok=True)
    figure, axes = plt.subplots(2, 3, figsize=(12.0, 5.6), layout="constrained")
    lines = ["# The same controller in MuJoCo and in Drake", "",
             "Written by `examples/your_loop/mujoco_beside_drake.py`. Force: mean (least to "
             "largest) over the last 3 s, then the largest of the run [N].", "",
             "| robot | wall | MuJoCo | Drake | tip's place at the end differs by | force sensor "
             "less solver | energy less work |", "|---|---|---|---|---|---|---|"]
    for row, (robot, cases) in zip(axes, CASES.items(), strict=True):
        scenario = uv.load_scenario(SCENARIOS[robot])
        model, desired = uv.load_model(scenario), scenario.task.force[0]
        for axis, (stiffer, off, duration) in zip(row, cases, strict=True):
            name = f"{robot}_{stiffer:g}_{off:g}"
            mujoco = kept(folder, f"mujoco_{name}", lambda robot=robot, case=(
                duration, stiffer, off): press(robot, *case))
            force, apart = "not run", "–"
            if not arguments.kept_only or (folder / f"drake_{name}.json").exists():
                drake = kept(folder, f"drake_{name}", lambda robot=robot, case=(
                    stiffer, off, duration): in_drake(robot, *case))
                ends = [model.task_pose(run["state"][-1][: model.size])[:3]
                        for run in (mujoco, drake)]
                force = over_end(drake)
                apart = f"{1e3 * np.linalg.norm(ends[0] - ends[1]):.1f} mm"
                axis.plot(drake["time"], drake["force"], label="Drake", linewidth=2.5, color="C1")
            change = mujoco["energy"] - mujoco["energy"][0]
            wall = f"{stiffer * scenario.surface.law.stiffness:.0f} N/m" + (
                f", {100 * off:.0f} cm off" if off else "")
            lines.append(
                f"| {robot}, {desired:g} N | {wall} | {over_end(mujoco)} | {force} | {apart} | "
                f"{np.max(np.abs(mujoco['sensed'] - mujoco['force'])):.3f} N | "
                f"{np.max(np.abs(change - mujoco['work'])):.3f} J of "
                f"{mujoco['traffic'][-1]:.0f} J |")
            axis.axhline(desired, color="0.7", linewidth=1.0)
            axis.plot(mujoco["time"], mujoco["force"], label="MuJoCo", linewidth=1.0, color="C0")
            axis.set_title(f"{robot}: {wall}", fontsize=10)
            axis.set_ylabel("force [N]")
            axis.set_xlabel("time [s]")
    axes[0, 0].legend()
    lines += ["", "![force over time in both](mujoco.png)", "",
              "What differs: MuJoCo integrates by semi-implicit Euler with 1 ms, its contact is a "
              "linear spring with a damper and an elliptic cone of friction, where ours is Hunt "
              "and Crossley's with a rounded beginning and friction that creeps; its force sensor "
              "has no bias and no drift. The water's coefficients are the same. Both robots "
              "declare walls of 1000 N/m at most: that of 1400 N/m is outside of their class, "
              "without a supervisor. The Girona's run on 350 N/m ends soon after it arrives.", ""]
    (RESULTS / "mujoco.md").write_text("\n".join(lines), encoding="utf-8")
    figure.savefig(RESULTS / "mujoco.png", dpi=110)


if __name__ == "__main__":
    main()
