"""Record of the benchmark's runs as CSV, a line for each run: without the samples of its force."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from uvms_drake.benchmark.benchmark import SAMPLED
from uvms_drake.common.errors import InvalidParameter, require

KEYS = ("controller", "robot", "case", "seed", "index")
"""Columns that tell a run from all others."""
TEXTS = ("controller", "robot", "case", "error", "ended")
"""Columns of text; all others are JSON."""


def write_runs(results: Sequence[dict[str, Any]], path: Path) -> None:
    """Writes the record of runs; a value that a run lacks is empty."""
    columns = dict.fromkeys(key for result in results for key in result if key != SAMPLED)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows([_text(result.get(key)) for key in columns] for result in results)


def read_runs(path: Path, **selected: Sequence[str]) -> list[dict[str, Any]]:
    """Returns the results of a record.

    Args:
        path: The file.
        selected: Names of the `controllers`, `robots` and `cases` to return; all if left out.

    Raises:
        InvalidParameter: There is no such file, it is no such record, or it has none of these.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            results = [{"error": None} | {
                key: text if key in TEXTS else json.loads(text)
                for key, text in line.items() if text} for line in csv.DictReader(file)]
    except (OSError, ValueError, AttributeError, csv.Error) as error:
        raise InvalidParameter("--recorded", str(path),
                               f"the CSV of a benchmark ({error})") from None
    require(bool(results) and all(key in results[0] for key in KEYS), "--recorded", str(path),
            f"the CSV of a benchmark, with the columns {', '.join(KEYS)}")
    for key, names in selected.items():
        results = [result for result in results if result[key.removesuffix("s")] in names]
    require(bool(results), "--recorded", str(path), "a benchmark with some of the selected runs")
    return results


def _text(value: Any) -> str:
    if value is None:
        return ""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
