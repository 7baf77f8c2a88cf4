"""The sub-command `compare`: puts several runs side by side."""

import argparse
from pathlib import Path

from uvms_drake.command.files import folder
from uvms_drake.common.errors import require
from uvms_drake.common.jsonable import write_json
from uvms_drake.common.output import output_folder

COMPARISON_FILES = ("compare.md", "compare.json", "compare.png")


def add_compare(commands: argparse._SubParsersAction) -> None:
    """Adds the sub-command to the parser."""
    compare = commands.add_parser(
        "compare", allow_abbrev=False,
        help="put runs side by side: figures of merit, keys that differ, signals overlaid")
    compare.set_defaults(command=compare_runs)
    compare.add_argument("folders", type=folder, nargs="+", metavar="DIR",
                         help="folder that 'run' has written; two to six of them")
    compare.add_argument("--output", type=folder, metavar="DIR", default=Path("out/compare"),
                         help=f"folder of {', '.join(COMPARISON_FILES)} (default: %(default)s)")


def compare_runs(args: argparse.Namespace) -> int:
    """Prints and writes the comparison of the runs in some folders."""
    from uvms_drake.report.compare import MOST

    require(2 <= len(args.folders) <= MOST, "DIR", [str(each) for each in args.folders],
            f"two to {MOST} folders")
    # Slow imports, after the arguments are known to be good.
    from uvms_drake.report.compare import (
        comparison_drawing,
        differing_keys,
        format_comparison,
        metrics_of,
    )
    from uvms_drake.report.drawing import save
    from uvms_drake.report.html import load_run
    from uvms_drake.report.summary import summarise

    records = [load_run(each)[0] for each in args.folders]
    names = short_names(args.folders)
    summaries = [summarise(record) for record in records]
    differences = differing_keys([record.scenario for record in records])
    text = format_comparison(names, summaries, differences)
    with output_folder(args.output, COMPARISON_FILES, replaces=True) as output:
        (output.folder / "compare.md").write_text(f"{text}\n", encoding="utf-8")
        data = {"runs": names, "metrics": [metrics_of(each) for each in summaries],
                "differences": differences}
        write_json(data, output.folder / "compare.json")
        save(comparison_drawing(names, records), output.folder / "compare.png")
    print(f"{text}\n\nwritten to {args.output}: {', '.join(sorted(output.kept))}")
    return 0


def short_names(folders: list[Path]) -> list[str]:
    """Returns names of the folders: their last parts, as many as tell all of them apart."""
    parts = [folder.resolve().parts for folder in folders]
    for count in range(1, max(map(len, parts)) + 1):
        names = ["/".join(each[-count:]) for each in parts]
        if len(set(names)) == len(names):
            return names
    return [str(folder) for folder in folders]  # One run twice.
