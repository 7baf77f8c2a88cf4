"""Measured results: runs every shipped scenario, small campaigns and the benchmark; writes tables.

`python examples/results/make_all.py` makes all pages of this folder again, with commit, date and
machine; `--only scenarios` makes one of them. The benchmark takes two hours on two cores, the
certificates in probability half an hour each, all others together an hour.
"""

import argparse
import datetime
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import uvms_drake as uv
from uvms_drake.benchmark.benchmark import read_record
from uvms_drake.campaign.failures import failures_of
from uvms_drake.certificate.in_probability import FAILURES, percent_above
from uvms_drake.station.scenario.scenario_file import shipped_scenarios

FOLDER = Path(__file__).parent
RUNS = 20
"""Runs of a campaign."""
REAL, DRAWN = "girona500_real_loop", 100
BLUE, DRAWN_BLUE = "bluerov2_real_loop", 20
"""Scenarios and numbers of runs of certificates in probability."""
CHANGED = """What changed: the page before was of another program and another protocol. Its seed
was chosen and its runs were not fixed before, only the norms of pose, joints and velocity had to be
inside of the tube, and a force that never settled was no failure: its number is withdrawn. Now the
seed follows from scenario, program and number of runs, attempts are counted and cost confidence,
every radius that tightens a limit is watched, and so is the force at the end of each hold; a fifth
of the runs is at a corner of all unknowns, and a press is held as `draws.hold` has it."""
"""Remark on the pages of certificates in probability."""
CALIBRATED = """Gains and tube are those of `uvms-drake calibrate girona500_real_loop --gains`,
from 20 pilot runs of another seed. What changed: on the page before, attempt 2, one of 60 runs
failed: at most 10.9 %. At the end of its hover the plan asked the sway thruster for 98 N, and that
has 95; `limits.u` along sway is smaller since, the tube as it was. Attempt 1 was interrupted,
without a result; it counts. The program is that of commit d466a03d."""
"""Remark on that of the scenario that is calibrated."""
MISSION, MISSIONS = "jacket_inspection_real", 10
"""Scenario and number of runs of a certificate in probability of a mission."""
EACH, EACH_SEED = 5, 2
"""Number of runs with each unknown, and their seed. Joint friction is stiff: a run with it takes
ten times as long."""
DRAWS = 20
"""Draws of each case of the benchmark."""
COMPARED = ("tube_mpc", "impedance", "sliding_coupled", "prescribed_performance_gravity",
            "nominal_mpc_offset_free")
"""Its controllers."""
IDEAL = "ideal"
"""Its case with an exact wrench."""
TRIED = (IDEAL, "thrusters", "navigation", "wall_off", "soft", "friction", "current", "gravity",
         "bias", "slide")
"""Its cases."""
OUTSIDE, OUTSIDE_DRAWS = ("stiff", "very_stiff", "hard", "wave", "drift", "stuck", "dead", "no_fix",
                          "frozen"), 1
"""Cases outside of the declared class, and their draws, of one robot: nearly an hour of a core."""
NONE = ("model_error.mass=1.0", "current=[0.0, 0.0, 0.0]")
"""The scenario without its unknowns."""
UNKNOWNS = {
    "none: wall anywhere in its class": (),
    "mass ± 20 %": ("model_error.mass=1.2",),
    "current 0.25 m/s": ("current=[0.0, 0.25, 0.0]",),
    "waves 0.2 m/s, 6 s": ("waves=[{amplitude: 0.25, period: 6.0}]",),
    "joint friction 0.5 N m": ("model_error.joint_friction.coulomb=[0.5]",),
    "payload 0.5 kg": ("model_error.payload.mass=0.5",),
    "trim ± 2 %": ("model_error.buoyancy=1.02",),
    "force of each thruster ± 10 %": ("actuation.1.error=[0.1]",),
    "clock of 20 Hz": ("actuation.0.period=0.05",),
    "DVL gaps of 0.4 s": (
        "sensing.0.dvl.rate=10.0", "sensing.0.dvl.gap=0.4", "sensing.0.dvl.lost=1.0"),
}
"""Options of each unknown. A gap has whole periods of fixes: at 9.5 Hz one of 0.4 s would be of
three, 0.32 s."""


def uvms_drake(*arguments: str, allowed: Sequence[int] = (0, 1, 3)) -> str:
    """Returns the output of a command; one that fails other than by its verdict ends the script."""
    done = subprocess.run([sys.executable, "-m", "uvms_drake", *arguments], capture_output=True,
                          text=True, check=False)
    if done.returncode not in allowed:
        raise SystemExit(f"uvms-drake {' '.join(arguments)}: {done.stderr}")
    return done.stdout


def provenance() -> str:
    """Returns commit, date and machine."""
    def git(*arguments: str) -> str:
        return subprocess.run(["git", *arguments], cwd=FOLDER, capture_output=True, text=True,
                              check=True).stdout.strip()

    dirty = " with local changes" if git("status", "--porcelain", "--untracked-files=no") else ""
    return (f"Commit {git('rev-parse', '--short', 'HEAD')}{dirty}, "
            f"{datetime.date.today().isoformat()}, {os.cpu_count()} cores ({platform.machine()}), "
            f"Python {platform.python_version()}, uvms_drake {uv.__version__}.")


def scenario_row(name: str, folder: Path) -> list[str]:
    """Returns a row of the table of scenarios, from a run of it."""
    command = ["run", name, "--output", str(folder), "--no-figures", "--no-replay"]
    uvms_drake(*command, allowed=(0, 1, 2, 3))
    if not (folder / "summary.json").exists():  # Refused: no proof of the worst case covers it.
        uvms_drake(*command, "--uncertified")
    summary = json.loads((folder / "summary.json").read_text("utf-8"))
    force, mission = summary["force"], summary["mission"]
    used = summary["tube"]["largest_use"]
    pressed = [row for row in mission["steps"] if "force_rms" in row] if mission else []
    # Of a mission, the worst of its steps in contact; of a press, the numbers that `run` prints.
    numbers = [("–" if value is None else format(abs(value), spec)) for value, spec in (
        (max((row["mean_force"] for row in pressed), default=None) if mission else
         float(np.linalg.norm(force["desired"][:3])), ".3g"),
        (max((row["force_rms"] for row in pressed), default=None) if mission else
         force["final_error_normal"], ".2g"),
        (None if mission else force["final_error_tangential"], ".2g"),
        (mission["over_s"] if mission else force["settling_time_s"], ".1f"),
        (None if used is None else 100.0 * used, ".0f"), (summary["real_time_factor"], ".2g"))]
    return [f"`{name}`", *numbers, summary["verdict"]["text"]]


def scenarios() -> str:
    """Returns the page of all shipped scenarios."""
    head = ["scenario", "force [N]", "error along it at the end [N]", "across it [N]",
            "settled, or mission over [s]", "of a radius of the tube used [%]",
            "real-time factor", "verdict"]
    rows = [head, ["---"] * len(head)]
    with tempfile.TemporaryDirectory() as folder:
        for name in shipped_scenarios():
            if not uv.load_scenario(name).simulation:
                print(name, file=sys.stderr)
                rows.append(scenario_row(name, Path(folder) / name))
    return "# Shipped scenarios, one run each\n\n" + "\n".join(
        f"| {' | '.join(row)} |" for row in rows) + SCENARIOS_NOTE


def campaigns() -> str:
    """Returns the page of two small campaigns: a known and an unknown surface."""
    parts = ["# Campaigns: randomised runs inside of the declared bounds"]
    for name in ("girona500_ideal", "girona500_contact"):
        print(f"campaign {name}", file=sys.stderr)
        command = ["campaign", name, "--runs", str(RUNS), "--seed", "1"]
        with tempfile.TemporaryDirectory() as folder:
            text = uvms_drake(*command, "--output", folder)
        text = "\n".join(line for line in text.splitlines() if folder not in line)
        parts.append(f"`uvms-drake {' '.join(command)}`\n\n```\n{text.strip()}\n```")
    return "\n\n".join(parts)


def benchmark() -> str:
    """Returns the page of the benchmark of controllers; its runs are kept in out/benchmark."""
    command, text, figures = compared("benchmark", DRAWS, TRIED)
    runs = read_record(FOLDER / "benchmark.csv")
    return "\n\n".join((
        "# Controllers of the field in the same cases", command,
        "![error of the force](benchmark.png)", reading(runs), text,
        "## Force since the touch, first draw", *figures,
        "## A controller of your own", own_controller()))


def benchmark_outside() -> str:
    """Returns the page of its cases outside of the declared class; runs: out/benchmark_outside."""
    command, text, figures = compared("benchmark_outside", OUTSIDE_DRAWS, OUTSIDE,
                                      "--robots", "girona500_arm5e")
    return "\n\n".join((
        "# Controllers of the field outside of the declared class", command,
        READING_OUTSIDE.strip(), text, "## Force since the event or the touch, first draw",
        *figures))


def compared(name: str, draws: int, cases: Sequence[str], *options: str
             ) -> tuple[str, str, list[str]]:
    """Runs the benchmark in out/`name`; returns its command, its tables and its figures."""
    print(name, file=sys.stderr)
    folder, command = Path("out") / name, [
        "benchmark", "--output", f"out/{name}", "--runs", str(draws),
        "--controllers", *COMPARED, "--cases", *cases, *options]
    text = uvms_drake(*command, *[FINISHED] * (FINISHED in sys.argv)).strip()
    shutil.copy(folder / "benchmark.csv", FOLDER / f"{name}.csv")
    figures = []
    for file in sorted(folder.glob("benchmark*.png")):
        to = file.name.replace("benchmark", name, 1)
        shutil.copy(file, FOLDER / to)
        figures += [f"![force of every case]({to})"] * (file.name != "benchmark.png")
    return f"`uvms-drake {' '.join(command)}`", text, figures


def reading(runs: Sequence[dict[str, Any]]) -> str:
    """Returns the reading of the page of the benchmark, with the counts of its runs."""
    errors = {(run["controller"], run["case"], run["index"]): run.get("force_rms", np.inf)
              for run in runs if run["robot"] == "girona500_arm5e"}
    smaller = {case: [error < errors["tube_mpc", case, index]
                      for (controller, tried, index), error in errors.items()
                      if controller == "impedance" and tried == case]
               for case in TRIED if case != IDEAL}
    counts = {case: f"{sum(each)} of {len(each)}" for case, each in smaller.items()}
    return READING.format(smaller=sum(map(sum, smaller.values())),
                          pairs=sum(map(len, smaller.values())), **counts).strip()


def own_controller() -> str:
    """Returns the section on a controller of one's own, of the benchmark's README."""
    text = (FOLDER.parents[1] / "uvms_drake" / "benchmark" / "README.md").read_text("utf-8")
    return text.split("## A controller of your own")[1].split("\n## ")[0].strip()


def probability(scenario: str, runs: int, folder: str, note: str) -> str:
    """Returns the page of a certificate in probability; its runs are kept in out/`folder`."""
    return "\n\n".join((
        "# Certificate in probability of the loop with thrusters and navigation",
        "No worst-case certificate holds for this loop. The runs are drawn from the distribution "
        "that the scenario declares: [certificate](../../uvms_drake/certificate#in-probability).",
        *certified_in_probability(scenario, runs, folder), note))


def certified_in_probability(scenario: str, runs: int, folder: str) -> list[str]:
    """Returns a table, the command and its output, of a certificate from drawn runs."""
    print(folder, file=sys.stderr)
    command = ["certify", scenario, "--runs", str(runs), "--full", "--output", f"out/{folder}"]
    text = uvms_drake(*command).strip()
    claim, times = (json.loads((Path("out") / folder / name).read_text("utf-8"))
                    for name in ("certificate.json", "runs/timing.json"))
    kinds = ", ".join(f"{count} {kind}" for kind, count in claim["kinds"].items() if count)
    table = [
        ["runs N", "attempt k", "failed", "fails with a probability of", "a run took [s]"],
        ["---"] * 5,
        [str(claim["runs"]), str(len(claim["attempts"])),
         f"{claim['failures']}" + (f" ({kinds})" if kinds else ""),
         f"at most {percent_above(claim['probability'])}, at "
         f"{100.0 * claim['confidence']:g} % confidence over all attempts",
         f"{times['seconds']['median']:.0f} in the median, two at a time"]]
    return ["\n".join(f"| {' | '.join(row)} |" for row in table),
            f"`uvms-drake {' '.join(command)}`", f"```\n{text}\n```"]


def missions() -> str:
    """Returns the page of a mission in probability; its runs are kept in out/missions."""
    parts = certified_in_probability(MISSION, MISSIONS, "missions")
    found = json.loads(Path("out/missions/runs/campaign.json").read_text("utf-8"))["results"]
    ended = "\n".join(
        f"| {run['index']} | {run['error'] or run['mission']['outcome']} | "
        + (f"{format(run['mission']['over_s'] or np.nan, '.1f')} | {max(run['use'].values()):.2f} |"
           if run["error"] is None else "– | – |")
        for run in found)
    return "\n\n".join((
        "# Certificate in probability of a mission with its slide",
        "So few runs tell whether the mission is done at all: the bound is as wide as it says. "
        "[Missions in probability](../../uvms_drake/mission#in-probability).", *parts,
        "| run | mission | over after [s] | largest use of a radius |\n| --- | --- | --- | --- |\n"
        + ended, CHANGED))


def each_unknown() -> str:
    """Returns the page of each unknown alone; the runs are kept in out/each_unknown."""
    head = ["alone", "failed", "largest use of a radius",
            "smallest margin of a limit over its size", "settled"]
    rows = [head, ["---"] * len(head)]
    command = ["campaign", REAL, "--uncertified", "--runs", str(EACH), "--seed", str(EACH_SEED)]
    for name, options in UNKNOWNS.items():
        print(name, file=sys.stderr)
        folder = Path("out") / "each_unknown" / re.sub(r"[^\w.]+", "_", name)
        sets = [part for option in (*NONE, *options) for part in ("--set", option)]
        if not uvms_drake(*command, *sets, "--output", str(folder)):
            raise SystemExit(f"{name}: no result")
        found = json.loads((folder / "campaign.json").read_text("utf-8"))
        failed = [kinds for run in found["results"] if (kinds := failures_of(run))]
        kinds = ", ".join(f"{sum(kind in each for each in failed)} {kind}" for kind in FAILURES
                          if any(kind in each for each in failed))
        ended = [run for run in found["results"] if run["error"] is None]
        use = max(((value, row) for run in ended for row, value in run["use"].items()),
                  default=None)
        margin = min((run["margin"] for run in ended), default=None)
        rows.append([
            name, f"{len(failed)} of {EACH}" + (f" ({kinds})" if kinds else ""),
            "–" if use is None else f"{use[0]:.2f} ({use[1]})",
            "–" if margin is None else f"{margin:.2f}",
            f"{EACH - found['counts']['never_settled'] - found['counts']['exceptions']}"])
    return "\n\n".join((
        "# Each unknown of the loop with thrusters and navigation alone",
        f"Campaigns of `{REAL}` with a few drawn runs each: so few tell whether an unknown breaks "
        "the loop, not that it hardly ever does, and are no certificates. A run fails as it would "
        "in a certificate in probability. Start, wall, desired force, noise and failing samples "
        "are drawn in every row: so the row without an unknown is that of a wall anywhere in its "
        "class. Mass, current, trim and force of each thruster are of either sign and up to the "
        "size; clock and gaps are as they stand. Gains and tube are those of the scenario, which "
        "was designed for 50 Hz and fixes that are seldom lost.",
        "\n".join(f"| {' | '.join(row)} |" for row in rows),
        f"Each row is `uvms-drake {' '.join(command)}` with {sets_of(NONE)} and",
        "\n".join(f"* {name}: {sets_of(options)}" for name, options in UNKNOWNS.items())))


def sets_of(options: Sequence[str]) -> str:
    """Returns options as words of a command."""
    return ", ".join(f'`--set "{option}"`' for option in options)


FINISHED = "--finished"
"""Option with which the page of the benchmark has the runs that are finished, and runs nothing."""
READING = """
All cases but `ideal` are of the robot with thrusters, a sampled loop and navigation. Five of the
nine controllers and ten of the thirteen cases within the declared class are here, with twenty
draws; those outside are [on a page of their own](benchmark_outside.md). Every run is a line of
[benchmark.csv](benchmark.csv). The force gains of the baselines are the best of three scales on
walls of 300, 1000 and 3000 N/m with another seed that keeps a margin on 5000 N/m, by
`examples/tune_baselines.py`, and those of a linear model where none does, as of most laws on the
BlueROV2: the same objective and budget for all, and no case of this page. Before that, the plain
form of the prescribed performance was taken after the gradient form diverged in `thrusters`, and
the force fed forward to it after a look at `ideal`. The tube MPC runs with its declared tube,
uncertified, is not tuned on these walls, and has gains of its own for the ideal loop. The laws
after Barbalata et al. and Heshmati-alamdari et al. follow their abstracts: equations and gains of
the papers could not be read, so a row is no verdict on the papers.

A difference of a quarter between two medians may be chance: resampled, half of those of the
force's error stay within 14 % and three quarters within 25 %, in 95 of 100 samples. Reading:

* **Tube MPC**: it breaks no limit on either robot; each of the others does. It has the smallest
  lateral error but in the slide, which its plan follows from behind, and a median peak at most a
  tenth above the desired force but for a biased sensor on the BlueROV2, on which its force error is
  the smallest except with a biased sensor and in the slide; in these two it does not settle there.
  It touches last, but for the nominal MPC in one case, and needs a model and the class of the wall.
  Its processor time of a step is too small here: samples at which the robot keeps its place count.
* **Impedance with an integral of the force**: on the Girona 500 behind thrusters nearly as good as
  the tube MPC where limits do not matter. Its error is smaller in {smaller} of the {pairs} runs of
  such cases: in {slide} as the place slides and in {gravity} with a heavier arm, but in
  {navigation} with an exact navigation, {bias} with a biased sensor and {soft} on a soft wall. It
  settles soonest in most cases, and computes little. On a soft wall
  and in the ideal loop the arm leaves its limits in every run, of which it knows nothing; so it
  does in every case on the BlueROV2, whose arm is heavy along the normal.
* **Coupled sliding mode**: small errors on all walls of the Girona 500, with a peak a quarter to a
  third above the desired force; weight that the model lacks makes it unstable. On the BlueROV2 it
  is slow and off by a fifth of the force behind thrusters, by three fifths with a biased sensor and
  by three quarters in the ideal loop and with a heavier arm.
* **Prescribed performance**, told the weight but no inertia: behind thrusters it presses with an
  error of about a fifth of the force, less on a soft wall, and of three quarters with a heavier arm
  on the Girona 500, and leaves its funnels some dozens of times a run.
* **Nominal MPC with an observer**: behind thrusters on the BlueROV2 its median error is 1.1 to 2.1
  times that of the tube MPC, on a soft wall 37 times, and some runs miss the whole force; with a
  heavier arm it breaks
  limits in every run on both robots. Without feedback between its plans a faster disturbance stays
  in the force, the sinusoid of the ideal loop, and on the Girona 500 friction, with which and in
  the slide it settles in no run; with the five slowest of the drawn thrusters, 0.131 s and more, it
  does not either, where the tube MPC takes 1.5 to 2.5 s.

Where another controller is better:

* **Navigation**: Between plans the tip is held stiffly at a place in the frame of the navigation,
  so that its noise becomes force; a compliant law lets it pass. The case `navigation` is the same
  run with the remedy, an exact navigation. Half the gains of the tip do not mend it: slower
  disturbances press more (tried on the Girona 500, first draw).
* **Steps of the plan**: A plan removes the part κ/κ̂ of the force's error, κ̂ the estimated
  stiffness with a deviation added, and the next is a step later: settling takes several. Half the
  step does not mend it (1.6 to 1.8 s), nor a declared class of softer walls, 700 N/m (3.0 s, with a
  peak of 23.5 N; both tried on the Girona 500, first draw). A stiffness that is known before the
  touch would, as that of `!KnownSurface` (not tried here).
* **Approach**: The plan touches with a speed that is bounded for the declared stiffness and the
  desired force; a law that comes more slowly touches more softly. A smaller `contact.speed` would
  mend it, for a longer approach, but has to be larger than the tube's speed of the tip.
* **Bias**: Every law follows its sensor, so that the bias is in every force; a law with an error of
  the other sign looks better. A second tare would mend it, for all (not tried).
* **Slide**: A plan knows of the place at its next step, and slides behind it within its limits.
  Half the step takes the error on the BlueROV2 from 0.71 to 0.55 N, but not on the Girona 500 (0.44
  to 0.58 N), where an exact navigation takes it to 0.39 N and a friction that is estimated sooner
  changes nothing (all tried, first draw).

What is not equal for all: both MPCs are told the drawn lag of the thrusters, exactly, and compute
the wrench by it; the baselines are told none. Each scale of the gains is the best of one draw, so
of one lag. Four controllers are left out, among them the admittance, whose objective on the
BlueROV2's walls is the smallest of the baselines (0.65 N, where that of the impedance is 1.1 N).

The runs are of the commit below. Of both robots gains, hover, tube and limits have changed since,
of the BlueROV2 the filter and the horizon, too; a supervisor was added to the tube MPC, and to
every baseline a stop above the declared largest force, which these runs had not. The command gives
other numbers today.
"""
"""Reading of the page of the benchmark."""
READING_OUTSIDE = """
One draw of each case, with thrusters, a sampled loop and navigation: a row is an example and no
statistic. A stiffer wall is one from the touch on; all other events are at 20 s, when every
controller presses, and force, time and joints are from there on. Every run is a line of
[benchmark_outside.csv](benchmark_outside.csv).

The tube MPC has its [supervisor](outside.md), with detections from declared errors and a model. A
baseline has the stop that an operator would give any law: above the declared 47 N, or with the tip
0.15 m off its reference across the direction, it goes 0.3 m straight back, as fast as the
supervisor does, and never presses again. The nominal MPC has none. Reading:

* **Waves, a current, no fixes**: the tube MPC has the smallest peak but in the current, in which
  two others are as low, and there it is carried least. In the waves the others press with 45 to 79
  N, the nominal MPC with more, and joints leave their range; those of the tube MPC never do.
* **Stiffer walls**: the impedance presses more softly at the touch, and goes on with the desired
  force, where the tube MPC lets go: on a wall of unknown stiffness it is the better choice.
* **A thruster that sticks**, without a power cut: no controller holds it, and the tube MPC is
  carried furthest. With a power cut see [outside.md](outside.md).
* **A dead thruster**: all lose the wall within four seconds, without a larger force; the supervisor
  has let go before.
* **A frozen force sensor**: the supervisor lets go; the baselines press on and know nothing of it.
"""
"""Reading of the page of its cases outside of the declared class."""
SCENARIOS_NOTE = """

The numbers are those that `run` prints, with its certificate, or with `--uncertified` where none
of the worst case is to be had. Of a mission: the largest mean force of its steps in
contact, and their largest rms error. The force across the direction is that of friction and of a
tilted wall: nothing asks for it to be zero. Scenarios with a simulation of their own, of the paper,
are left out."""
"""Text below the table of scenarios."""
SPEED_NOTE = """Processor time on one core, old and new in turns, each measurement a process of its
own; medians. A run counts with everything that it loads, a certificate from an empty cache, a
campaign's run is its second one. The rows on the step are its effect: the largest change of state
and force in a run as the chosen step is halved."""
"""Text above the table of speeds."""
SPEED_READING = """Most of a run are derivatives, and most of a derivative are the law, which
computes the motion of two robots, and the water. Each is some
dozens of calls of NumPy on arrays of ten numbers, whose arithmetic is little. A short run has its
start in it, for which the robot is read three times, and two loops are built: one for the choice of
the step."""
"""Reading of the table of speeds."""
PAGES: dict[str, Callable[[], str]] = {
    "scenarios": scenarios, "campaigns": campaigns, "benchmark": benchmark,
    "benchmark_outside": benchmark_outside,
    "missions": missions,
    "probability": partial(probability, REAL, DRAWN, "probability", CALIBRATED),
    "probability_bluerov2": partial(
        probability, BLUE, DRAWN_BLUE, "probability_bluerov2", CHANGED),
    "each_unknown": each_unknown}
IMPORT = "robot_import"
PRINTED = "holds", "unknowns", "adversaries", "solvers"
"""Pages with a script of their own; those of the second kind print it."""
SPEED = "speed"
"""Page beside an older checkout, which `--old` names; without it that page stays as it is."""


def speed(old: Path) -> str:
    """Returns the page of speeds beside those of an older checkout."""
    def commit(checkout: Path) -> str:
        return subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=checkout, check=True,
                              capture_output=True, text=True).stdout.strip()

    print(SPEED, file=sys.stderr)
    table = subprocess.run([sys.executable, FOLDER / "speed.py", old], check=True,
                           stdout=subprocess.PIPE, text=True).stdout
    return (f"# Speed beside commit {commit(old)}\n\n{SPEED_NOTE}\n\n{table.strip()}\n\n"
            f"{SPEED_READING}")


def main() -> None:
    """Makes the selected pages."""
    parser = argparse.ArgumentParser(description=__doc__)
    names = [*PAGES, IMPORT, *PRINTED]
    parser.add_argument("--only", choices=[*names, SPEED], nargs="+")
    parser.add_argument("--old", type=Path, help="speed: path of an older checkout")
    parser.add_argument(FINISHED, action="store_true",
                        help="benchmark: the finished runs in out/benchmark alone")
    arguments = parser.parse_args()
    old = arguments.old
    if SPEED in (arguments.only or []) and old is None:
        parser.error("--only speed: --old, the path of an older checkout, is missing")
    for name in arguments.only or [*names, *([SPEED] if old else [])]:
        if name == IMPORT:
            subprocess.run([sys.executable, FOLDER / f"{IMPORT}.py"], check=True)
            continue
        if name in PRINTED:
            page = subprocess.run([sys.executable, FOLDER / f"{name}.py"], check=True,
                                  stdout=subprocess.PIPE, text=True).stdout
            (FOLDER / f"{name}.md").write_text(page, encoding="utf-8")
            continue
        page = speed(old) if name == SPEED else PAGES[name]()
        (FOLDER / f"{name}.md").write_text(
            f"{page}\n\nMade by `python examples/results/make_all.py --only {name}`. "
            f"{provenance()}\n", encoding="utf-8")


if __name__ == "__main__":
    main()
