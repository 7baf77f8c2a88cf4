"""The coupled linear budget as text."""

import numpy as np

from uvms_drake.tube.coupled.budget import CoupledBudget


def coupled_rows(budget: CoupledBudget | None) -> list[str]:
    """Returns the lines of a budget: of each stage its sources × rows and sums; the limits."""
    if budget is None:
        return []
    joints = [row for row in budget.rows if row.startswith("q") and not row.endswith("rate")]
    shown = ["depth", "tip y", "tip z", "vehicle x", "roll", "pitch", *joints[:3], "depth speed"]
    of = [budget.rows.index(row) for row in shown]

    def row(name: str, values: np.ndarray) -> str:
        return f"  {name:<34}" + "".join(f"{1e3 * value:>12.3g}" for value in values[of])

    left = "".join(f"{1e3 * budget.left[name]:>12.3g}" if name in budget.left else f"{'-':>12}"
                   for name in shown)
    out = ["", "coupled loop, linear about the task's posture, without a slide on the wall; its "
           "remainder is not bounded [mm, mrad, mm/s]: it is no proof"]
    for stage in budget.stages:
        out += [f"  {stage.name:<34}" + "".join(f"{name:>12}" for name in shown),
                *(row(f"{each.name}, worst{'' if each.counted else ', not counted'}", each.worst)
                  for each in stage.sources),
                *(row(f"{each.name}, σ", each.std) for each in stage.sources if each.random),
                row("sum, worst case", stage.worst),
                row(f"sum of those counted, but for {budget.chance:g}", budget.by_chance(stage)),
                row(f"the same, largest of {budget.postures} drawn postures", stage.elsewhere)]
    return [*out, f"  {'limits leave':<34}{left}"]
