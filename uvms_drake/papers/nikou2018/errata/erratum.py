"""An erratum, and the table of all of them."""

import textwrap
from dataclasses import dataclass


@dataclass(frozen=True)
class Erratum:
    """A statement of the paper and the result of a computation about it."""

    number: str
    """Number in the list: E1, E2, ..."""
    title: str
    where: str
    """LaTeX labels of the paper, with ", " between them."""
    printed: str
    """Statement of the paper."""
    computed: str
    """Result of the computation, made of computed numbers."""
    consequence: str
    wrong: bool
    """Verdict of the computation: whether the paper's statement fails."""

    @property
    def verdict(self) -> str:
        """Word for a table."""
        return "confirmed" if self.wrong else "not confirmed"


def errata_table(errata: list[Erratum], width: int = 100) -> str:
    """Returns the errata as plain text, `width` characters wide."""
    lines = [f"{sum(item.wrong for item in errata)} of {len(errata)} errata confirmed by "
             "computation"]
    for item in errata:
        lines += ["", *textwrap.wrap(
            f"{item.number:<5}{item.title} ({item.where}): {item.verdict}", width,
            subsequent_indent=" " * 5, break_on_hyphens=False)]
        for label in ("printed", "computed", "consequence"):
            lines += textwrap.wrap(
                getattr(item, label), width, initial_indent=f"     {label + ':':<13}",
                subsequent_indent=" " * 18, break_on_hyphens=False)
    return "\n".join(lines)


def errata_markdown(errata: list[Erratum]) -> str:
    """Returns the errata as a table for the README."""
    rows = [("", "erratum", "printed", "computed", "consequence", ""), ("---",) * 6]
    for item in errata:
        labels = ", ".join(f"`{label}`" for label in item.where.split(", "))
        rows.append((item.number, f"**{item.title}** ({labels})", item.printed, item.computed,
                     item.consequence, item.verdict))
    return "\n".join(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in row)} |"
                     for row in rows)
