"""Robot files as they are found, from the file to the press: times, and what was taken or guessed.

It takes made-up files of the shapes that people have through `robot --from`, `robot`,
`scenario --new`, `certify` and `run`, and writes the table robot_import.md beside it. Nothing is
edited by hand between the steps.
"""

import argparse
import json
import os
import re
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

Made by `python examples/results/robot_import.py`: `robot --from`, `robot`, `scenario --new` (which
computes the certificate and puts its advice in), `certify` and `run`, nothing edited in between.
Times are processor time on a core that others were using, with the start of Python in each. *Kept*
is the part of the disturbance (a current of 0.2 m/s, 0.1 N m of friction) that the certificate
covers after its own advice. The tolerance is a tenth of the force.

| file | shape | joints | force | from, robot | scenario | certify | run | kept | bound | \
within tolerance | off in the last 5 s |
|---|---|---|---|---|---|---|---|---|---|---|---|
"""
LISTS = """
## What was taken, changed and guessed

The heads of the lines that `robot --from` prints; each line has the numbers.

| file | taken from the file | changed | guessed, for its owner to give |
|---|---|---|---|
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
    "light_rov.urdf": Case("as xacro expands it: `<limits>` on rotors, origins twice, jaws", 5.0),
    "plugins.sdf": Case("SDFormat, z up, plugins of gz-sim", 10.0),
    "dummy_root.urdf": Case("a dummy root, sensors of limits 0..0", 10.0),
    "nested.sdf": Case("includes in includes", 10.0),
    "rounded.urdf": Case("rounded 6×6 matrices in plugins of uuv_simulator", 50.0),
    "wide_limits.urdf": Case("limits of 0.03..6.02, the tool along z", 5.0),
    "dae_arm.urdf": Case("FRD matrices of uuv_simulator, an arm of COLLADA", 300.0),
    "winged.urdf": Case("a glider with wings and a propeller", 3.0),
    "millimetres.urdf": Case("meshes in millimetres without a scale", 10.0),
    "camera_first.urdf": Case("a camera on four joints before an arm of three", 10.0),
    "dead_band.sdf": Case("thrusters with dead bands, three with one limit alone", 15.0),
    "pilot.sdf": Case("limits of thrusters in ArduPilotPlugin alone", 5.0),
}


def main() -> int:
    """Takes the files through all steps and writes their rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", default=list(CASES),
                        help="names of files; rows of others stay as they are")
    arguments = parser.parse_args()
    for name in arguments.files:
        with tempfile.TemporaryDirectory() as folder:
            rows = press(name, CASES[name], Path(folder))
        tables = [table | {name: row} for table, row in zip(read_tables(), rows, strict=True)]
        text = "".join(head + "".join(f"{table[file]}\n" for file in CASES if file in table)
                       for head, table in zip((HEAD, LISTS), tables, strict=True))
        TABLE.write_text(text, encoding="utf-8")
        print(rows[0], flush=True)
    return 0


def read_tables() -> list[dict[str, str]]:
    """Returns the rows of both tables that are there, by file."""
    text = TABLE.read_text(encoding="utf-8") if TABLE.is_file() else ""
    return [{line.split("`")[1]: line for line in part.splitlines() if line.startswith("| `")}
            for part in text.partition("\n## ")[::2]]


def heads(lines: list[str]) -> str:
    """Returns the beginnings of lines, up to the first colon and blank, in a cell of a table."""
    return "; ".join(dict.fromkeys(line.partition(": ")[0] for line in lines)) or "nothing"


def press(name: str, case: Case, folder: Path) -> tuple[str, str]:
    """Returns the rows of a file, whose robot is written, certified and presses in a folder."""
    robot, scenario = folder / Path(name).stem, folder / "press.yaml"
    out, notes = folder / "out", import_robot(FILES / name, Path(name).stem).notes
    for step, arguments in zip(STEPS, (
            ["robot", "--from", str(FILES / name), str(robot)], ["robot", str(robot)],
            ["scenario", "--new", str(scenario), "--robot", str(robot), "--force",
             f"{case.force:g}", "--quiet"],
            ["certify", str(scenario), "--quiet"],
            ["run", str(scenario), "--quiet", "--no-figures", "--no-replay", "--output",
             str(out)]), strict=True):
        case.times[step] = timed(arguments, folder)
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    bounds = json.loads((out / "certificate.json").read_text(encoding="utf-8"))["bounds"]
    force, settled = summary["force"], summary["force"]["settling_time_s"]
    joints = (robot / f"{robot.name}.sdf").read_text(encoding="utf-8").count("<joint ")
    quick = " + ".join(f"{case.times[step]:.0f}" for step in STEPS[:2])
    slow = " | ".join(f"{case.times[step]:.0f} s" for step in STEPS[2:])
    kept = re.search(r"(\d+%) of a current", scenario.read_text(encoding="utf-8"))
    pressed = "never" if settled is None else f"from {settled:.2f} s on"
    return (f"| `{name}` | {case.shape} | {joints} | {case.force:g} N | {quick} s | {slow} | "
            f"{'all' if kept is None else kept[1]} | {bounds['force']:.2g} N | {pressed} | "
            f"{force['last_5_s']['worst_normal_error']:.2g} N |",
            f"| `{name}` | {heads(notes.taken)} | {heads(notes.changed)} | {heads(notes.asked)} |")


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
