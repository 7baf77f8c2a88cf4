"""Robot files as they are found, from the file to the press: steps, times and changes.

It takes made-up files of the shapes that people have through `robot --from`, `robot`,
`scenario --new`, `certify` and `run`, and writes the table robot_import.md beside it. Nothing is
edited by hand between the steps.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

from uvms_drake.model.robot_import.importer import import_robot

FILES = Path(__file__).parents[2] / "tests" / "robot_files"
TABLE = Path(__file__).with_suffix(".md")
STEPS = ("from", "robot", "scenario", "certify", "run")
HEAD = """\
# Robot files from the file to the press

Made by `python examples/results/robot_import.py`: `robot --from`, `robot`, `scenario --new`,
`certify` and `run`, nothing edited in between. Times are processor time on a core that others were
using, with the start of Python in each. *Taken*, *changed*, *asked* count the lines of the printed
list. The tolerance is a tenth of the force.

| file | shape | joints | taken, changed, asked | force | from, robot, scenario | certify | run | \
bound | within tolerance | off in the last 5 s |
|---|---|---|---|---|---|---|---|---|---|---|
"""


@dataclass
class Case:
    """A file, and the task of its robot."""

    shape: str
    force: float
    """On the wall [N]."""
    times: dict[str, float] = field(default_factory=dict)
    """Processor time by step [s]."""


CASES = {
    "heavy_rov.urdf": Case("a heavy ROV, an arm of seven functions, STL, no water", 20.0),
    "light_rov.urdf": Case("rotors, a camera, jaws that mimic, COLLADA", 5.0),
    "plugins.sdf": Case("SDFormat, z up, plugins of gz-sim", 10.0),
    "dummy_root.urdf": Case("a dummy root, sensors of limits 0..0", 10.0),
    "nested.sdf": Case("includes in includes", 10.0),
    "rounded.urdf": Case("rounded 6×6 matrices in plugins of uuv_simulator", 50.0),
    "wide_limits.urdf": Case("limits of 0.03..6.02, the tool along z", 5.0),
    "dae_arm.urdf": Case("FRD matrices of uuv_simulator, an arm of COLLADA", 300.0),
    "winged.urdf": Case("a glider with wings and a propeller", 3.0),
    "millimetres.urdf": Case("meshes in millimetres without a scale", 10.0),
}


def main() -> int:
    """Takes the files through all steps and writes their rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", default=list(CASES),
                        help="names of files; rows of others stay as they are")
    arguments = parser.parse_args()
    for name in arguments.files:
        with tempfile.TemporaryDirectory() as folder:
            row = press(name, CASES[name], Path(folder))
        rows = {line.split("`")[1]: line for line in read_rows()} | {name: row}
        text = HEAD + "\n".join(rows[file] for file in CASES if file in rows) + "\n"
        TABLE.write_text(text, encoding="utf-8")
        print(row, flush=True)
    return 0


def read_rows() -> list[str]:
    """Returns the rows of the table that is there."""
    text = TABLE.read_text(encoding="utf-8") if TABLE.is_file() else ""
    return [line for line in text.splitlines() if line.startswith("| `")]


def press(name: str, case: Case, folder: Path) -> str:
    """Returns the row of a file, whose robot is written, certified and presses in a folder."""
    robot, scenario = folder / Path(name).stem, folder / "press.yaml"
    out, notes = folder / "out", import_robot(FILES / name, Path(name).stem).notes
    for step, arguments in zip(STEPS, (
            ["robot", "--from", str(FILES / name), str(robot)], ["robot", str(robot)],
            ["scenario", "--new", str(scenario), "--robot", str(robot), "--force",
             f"{case.force:g}"],
            ["certify", str(scenario), "--quiet"],
            ["run", str(scenario), "--quiet", "--no-figures", "--no-replay", "--output",
             str(out)]), strict=True):
        case.times[step] = timed(arguments, folder)
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    bounds = json.loads((out / "certificate.json").read_text(encoding="utf-8"))["bounds"]
    force, settled = summary["force"], summary["force"]["settling_time_s"]
    joints = (robot / f"{robot.name}.sdf").read_text(encoding="utf-8").count("<joint ")
    quick = " + ".join(f"{case.times[step]:.0f}" for step in STEPS[:3])
    counts = ", ".join(str(len(item)) for item in (notes.taken, notes.changed, notes.asked))
    pressed = "never" if settled is None else f"from {settled:.2f} s on"
    return (f"| `{name}` | {case.shape} | {joints} | {counts} | {case.force:g} N | {quick} s | "
            f"{case.times['certify']:.0f} s | {case.times['run']:.0f} s | "
            f"{bounds['force']:.2g} N | {pressed} | "
            f"{force['last_5_s']['worst_normal_error']:.2g} N |")


def timed(arguments: list[str], folder: Path) -> float:
    """Returns the processor time [s] of a command that runs in a folder, and must end well."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "uvms_drake", *arguments], check=True, cwd=folder,
                   stdout=subprocess.DEVNULL, env=os.environ | {
                       "OPENBLAS_NUM_THREADS": "1", "XDG_CACHE_HOME": str(folder / "cache")})
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    sys.exit(main())
