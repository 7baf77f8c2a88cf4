"""Figures of a campaign as drawings, one idea each, at the width of a column in a paper."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from uvms_drake.report.drawing import Drawing, Panel, Series, band, line, save
from uvms_drake.report.figure_style import BLUE, LIMIT, ORANGE, tube_label

RATIOS_FILE, MARGINS_FILE = "campaign_ratios.png", "campaign_margins.png"
OUTCOMES_FILE, WALLS_FILE = "campaign_outcomes.png", "campaign_walls.png"
CAMPAIGN_FIGURES = (RATIOS_FILE, MARGINS_FILE, OUTCOMES_FILE)
"""Figures of every campaign; `WALLS_FILE` is that of a sensed contact."""
BINS = 24
SPREAD = 0.14
"""Distance of the points of two kinds from the middle of their row."""
DOT: dict[str, Any] = {"markersize": 2.2, "alpha": 0.5, "markeredgewidth": 0.0, "linestyle": "",
                       "marker": "o"}

Results = Sequence[Mapping[str, Any]]


def make_campaign_figures(summary: Mapping[str, Any], folder: Path) -> None:
    """Writes the figures of the content of campaign.json, if a run counts."""
    done = [result for result in summary["results"] if result["error"] is None
            and result["inside"]]
    if not done:
        return
    drawings = {RATIOS_FILE: ratios_drawing(done, bool(summary["certified"])),
                MARGINS_FILE: margins_drawing(done),
                OUTCOMES_FILE: outcomes_drawing(done, summary["force_tolerance"])}
    if "walls" in summary:
        drawings[WALLS_FILE] = walls_drawing([result["wall"] for result in done])
    for name, drawing in drawings.items():
        save(drawing, folder / name)


def ratios_drawing(results: Results, certified: bool) -> Drawing:
    """Returns the worst deviation of each run over its two bounds, by disturbance."""
    kinds = sorted({result["disturbance"] for result in results})
    series = [_limit(1.0, len(kinds), tube_label(certified))]
    for name, label, color, shift in (("ratio_trajectory", "along the run", BLUE, SPREAD),
                                      ("ratio_set", "set-wise", ORANGE, -SPREAD)):
        series += _dots(((result[name], shift - kinds.index(result["disturbance"]))
                         for result in results), color, label=label)
    most = max(float(np.max(each.x)) for each in series if each.x is not None)
    return Drawing([[Panel(
        "", np.zeros(0), series, rows=[kind.replace("_", " ") for kind in kinds],
        window=(0.0, 1.05 * most), x_label="worst deviation of a run over its bound")]], 2.8, 3)


def margins_drawing(results: Results) -> Drawing:
    """Returns the smallest margin of each run to each constraint, over the constraint's size."""
    lowest = {name: min(result["margins"][name] for result in results)
              for name in results[0]["margins"]}
    names = sorted(lowest, key=lambda name: lowest[name])
    series = [_limit(0.0, len(names), None)]
    for row, name in enumerate(names):
        series += _dots(((result["margins"][name], -row) for result in results), BLUE, alpha=0.25)
    series.append(line(-np.arange(len(names)), {"color": ORANGE, "marker": "|", "markersize": 5},
                       x=np.array([lowest[name] for name in names]), linestyle="",
                       label="worst run"))
    return Drawing([[Panel(
        "", np.zeros(0), series, rows=[name.replace("_", " ") for name in names],
        window=(min(1.05 * lowest[names[0]], -0.02), 1.0),
        x_label="smallest margin of a run over the constraint's size")]],
        0.7 + 0.13 * len(names))


def outcomes_drawing(results: Results, tolerance: float) -> Drawing:
    """Returns the histograms of final force error and settling time.

    Args:
        results: Results of the runs.
        tolerance: Force error below which the force counts as settled [N].
    """
    panels = []
    for name, label in (("force_error", "force error at the end [N]"),
                        ("settling_time_s", "settling time of the force [s]")):
        values = [result[name] for result in results if result[name] is not None]
        most = 1.02 * max([*values, tolerance])
        counts, edges = np.histogram(values, BINS, range=(0.0, most))
        panels.append(Panel(
            "runs", edges, [band(0.0, np.append(counts, 0), step="post", color=BLUE)],
            limits=(0.0, 1.05 * max(1, np.max(counts))), window=(0.0, most),
            x_label=f"{label}, {len(values)} of {len(results)} runs"))
    settled = line(np.array([0.0, len(results)]), LIMIT, x=np.full(2, tolerance),
                   label="counts as settled")
    panels[0] = Panel(**{**vars(panels[0]), "series": [*panels[0].series, settled]})
    return Drawing([panels], 2.9, key=[settled])


def walls_drawing(walls: Results) -> Drawing:
    """Returns static force and settling time on unknown surfaces over their stiffness."""
    most = 1.02 * max(wall["stiffness"] or 0.0 for wall in walls) or 1.0
    panels = []
    for name, label, more in (
            ("static", "largest static force\nover the largest allowed",
             [line(1.0, LIMIT, label="largest allowed")]),
            ("settled_s", "from touch\nto settled [s]", [line(0.0, {"linestyle": ""})])):
        dots = _dots(((wall["stiffness"], wall[name]) for wall in walls), BLUE)
        panels.append(Panel(label, np.zeros(0), [*more, *dots], scale="zero", window=(0.0, most),
                            x_label="largest slope of the wall's static force [N/m], "
                                    f"{len(walls)} walls"))
    return Drawing([panels], 2.9)


def _dots(points: Iterable[tuple[float | None, float | None]], color: str, **style: Any
          ) -> list[Series]:
    """Returns the points of which both coordinates are known as a series, if there are any."""
    known = np.array([point for point in points if None not in point], dtype=float)
    return [line(known[:, 1], DOT, x=known[:, 0], color=color, **style)] if len(known) else []


def _limit(at: float, rows: int, label: str | None) -> Series:
    """Returns a vertical line over so many rows."""
    return line(np.array([0.5, 0.5 - rows]), LIMIT, x=np.full(2, at), label=label)
