"""The sub-command `bench`: measures computation times of a scenario."""

import argparse
import sys
from contextlib import closing
from pathlib import Path

from uvms_drake.command.files import folder, take_scenario
from uvms_drake.command.progress import Bar, stream_of
from uvms_drake.common.output import output_folder
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.scenario.scenario_file import reported_in, scenario_source, set_options


def add_bench(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    bench = commands.add_parser("bench", help="measure computation times of a scenario",
                                allow_abbrev=False)
    bench.set_defaults(command=bench_scenario)
    take_scenario(bench)
    bench.add_argument("--output", type=folder, metavar="DIR",
                       help="folder of bench.json (default: out/<scenario>)")


def bench_scenario(args: argparse.Namespace) -> int:
    """Prints and writes the computation times of a scenario."""
    from uvms_drake.studies.bench.bench import BENCH_FILE, measure, write_bench
    from uvms_drake.studies.bench.bench_table import format_bench

    scenario = load_scenario(args.scenario, args.overrides)
    path = args.output if args.output is not None else Path("out") / scenario.name
    with output_folder(path, [BENCH_FILE]) as output:
        with (reported_in(scenario_source(args.scenario, set_options(args.overrides))),
              closing(Bar("measuring", stream_of(args))) as progress):
            bench = measure(scenario, progress=progress)
        write_bench(bench, output.folder)
    print(format_bench(bench))
    print(f"written to {path}: {BENCH_FILE}", file=sys.stderr)
    return 0
