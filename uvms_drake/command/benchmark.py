"""The sub-command `benchmark`: the field's controllers and one's own, in the same cases."""

import argparse
import sys
from pathlib import Path

from uvms_drake.command.campaign import take_workers
from uvms_drake.command.files import folder, left_out, take_quiet
from uvms_drake.command.progress import bar
from uvms_drake.common.output import output_folder

JSON_FILE, TABLE_FILE, CSV_FILE = "benchmark.json", "benchmark.md", "benchmark.csv"

SELECTED = ("controllers", "robots", "cases")
"""Options that select runs."""


def add_benchmark(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    benchmark = commands.add_parser(
        "benchmark", allow_abbrev=False,
        help="compare controllers that press on a wall, on the same robots, cases and draws")
    benchmark.set_defaults(command=run_benchmark, parser=benchmark)
    benchmark.add_argument("--controllers", nargs="+", metavar="NAME",
                           help="names, or FILE.py:FUNCTION of a controller of one's own "
                                "(default: all of this package)")
    benchmark.add_argument("--robots", nargs="+", metavar="ROBOT", help="default: all")
    benchmark.add_argument("--cases", nargs="+", metavar="CASE", help="default: all")
    benchmark.add_argument("--runs", type=int, default=1, metavar="N",
                           help="number of draws of each case (default: %(default)s)")
    benchmark.add_argument("--seed", type=int, default=1, metavar="S",
                           help="draw i is a function of this and of i (default: %(default)s)")
    benchmark.add_argument("--output", type=folder, default=Path("out/benchmark"), metavar="DIR",
                           help="folder to write to; finished runs in it are not repeated "
                                "(default: %(default)s)")
    take_workers(benchmark)
    kept = benchmark.add_mutually_exclusive_group()
    kept.add_argument("--finished", action="store_true",
                      help="compute nothing: tables and figures of the runs in the folder, of "
                           "whole draws if there are any")
    kept.add_argument("--recorded", type=Path, metavar="FILE.csv",
                      help="compute nothing: tables of the selected runs of a benchmark.csv, of "
                           "whichever version of the package")
    take_quiet(benchmark)


def run_benchmark(args: argparse.Namespace) -> int:
    """Computes the missing runs; writes tables, figures and data, and prints the tables."""
    from uvms_drake.benchmark.benchmark import completed, read_record, runs_of, write_record
    from uvms_drake.benchmark.cases import CASES, ROBOTS
    from uvms_drake.benchmark.controllers import CONTROLLERS
    from uvms_drake.benchmark.figures import OVERVIEW, figure_name, write_figures
    from uvms_drake.benchmark.table import format_benchmark, summarise
    from uvms_drake.campaign.pool import make_pool
    from uvms_drake.common.jsonable import write_json

    robots, recorded = args.robots or list(ROBOTS), None
    if args.recorded is not None:
        left_out(args, ("runs", "seed", "workers", "scheduler"), "with --recorded: nothing is run")
        recorded = read_record(args.recorded, **{
            key: getattr(args, key) for key in SELECTED if getattr(args, key)})
    else:
        pool = make_pool(args.workers, args.scheduler)
        runs = runs_of(args.controllers or list(CONTROLLERS), robots, args.cases or list(CASES),
                       args.runs, args.seed)
    own = (JSON_FILE, TABLE_FILE, CSV_FILE, OVERVIEW, *(figure_name(robot) for robot in robots))
    with output_folder(args.output, own) as output:
        with bar(args, "running") as progress:
            results = recorded or completed(
                runs, args.output, pool, progress, finished=args.finished)
        # Data, tables and figures of the results.
        summary = summarise(results)
        text = format_benchmark(summary)
        write_json(summary, output.folder / JSON_FILE)
        (output.folder / TABLE_FILE).write_text(text + "\n", encoding="utf-8")
        write_record(results, output.folder / CSV_FILE)
        write_figures(results, summary, output.folder)
    print(text)
    print(f"written to {args.output}: {', '.join(sorted(output.kept))}", file=sys.stderr)
    return 0
