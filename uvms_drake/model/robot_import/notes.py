"""The list of an import: taken, changed, and for the owner to give."""

from dataclasses import dataclass, field

TITLES = (("taken", "Taken from the file"), ("changed", "Changed"),
          ("asked", "For you to give (the number in the files until then is an ESTIMATE)"))


@dataclass
class Notes:
    """Lines that an import has to say, in the order in which they were found."""

    sdf: str
    """Name of the robot's file."""
    taken: list[str] = field(default_factory=list)
    changed: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def ask(self, file: str, key: str, question: str) -> None:
        """Asks for a number: the file and key to set, and its meaning."""
        self.asked.append(f"{file}, {key}: {question}")

    def format(self) -> str:
        """Returns the list, numbered throughout."""
        lines, number = [], 0
        for key, title in TITLES:
            items = getattr(self, key)
            lines.append(f"{title}:" if items else f"{title}: nothing.")
            for item in items:
                number += 1
                lines.append(f"{number:3}. {item}")
            lines.append("")
        return "\n".join(lines)


def listed(names: list[str], most: int = 12) -> str:
    """Returns names in one line; of many, the first ones and how many more."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
