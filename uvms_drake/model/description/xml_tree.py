"""XML with the line of every element, read and written so that the lines stay the same.

Prefixes such as `drake:` are parts of the names, whether they are declared or not, as they are to
Drake's parsers. Attributes of URDF are elements in SDFormat: `Node.value` finds both.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform, RollPitchYaw

from uvms_drake.common.errors import InvalidFile, InvalidParameter, require

NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", re.ASCII)
MOST = 1e9
"""Size of a number from which it is none of a robot's."""


@dataclass
class Node:
    """An element of XML."""

    tag: str
    line: int
    attributes: dict[str, str] = field(default_factory=dict)
    text: str = ""
    """All text between its tags that is in none of its children."""
    children: list["Node"] = field(default_factory=list)
    file: Path = Path()
    mistakes: list[str] = field(default_factory=list, compare=False)
    """Complaints about the limits and losses of a joint in a file of others, which matter only if
    it is one of the arm's."""
    used: bool = field(default=False, compare=False)
    """Whether its text was asked for."""

    def all(self, path: str) -> "Iterator[Node]":
        """Yields the elements at a path of tags, such as `geometry/box`."""
        tag, _, rest = path.partition("/")
        for child in self.children:
            if child.tag == tag:
                yield from child.all(rest) if rest else [child]

    def find(self, path: str) -> "Node | None":
        """Returns the element at a path of tags; None without it.

        Raises:
            InvalidParameter: It is there twice.
        """
        found = list(self.all(path))
        require(len(found) < 2, self.place(), path,
                f"there once: lines {', '.join(str(node.line) for node in found)}")
        return found[0] if found else None

    def walk(self) -> "Iterator[Node]":
        """Yields the element and all below it, in the order of the text."""
        waiting = [self]
        while waiting:
            node = waiting.pop()
            yield node
            waiting += node.children[::-1]

    def value(self, path: str) -> str | None:
        """Returns the text at a path: of an attribute, or of an element or its `value`.

        It is None if there is neither.
        """
        above, _, name = path.rpartition("/")
        node = self.find(above) if above else self
        if node is None or name in node.attributes:
            return None if node is None else node.attributes[name].strip()
        if (child := node.find(name)) is None:
            return None
        child.used = True
        return child.attributes.get("value", child.text).strip()

    def meaning(self) -> tuple[object, ...]:
        """Returns all that an element says: numbers count by their values, places not at all."""
        return (self.tag, _words(self.text), *sorted(
            (key, _words(text)) for key, text in self.attributes.items()),
            *(child.meaning() for child in self.children))

    def is_true(self, path: str) -> bool:
        """Whether the text at a path is a yes."""
        return (self.value(path) or "").lower() in ("true", "1")

    def name(self, key: str = "name") -> str:
        """Returns an attribute or a text that has to be there."""
        found = self.value(key)
        if not found:
            raise InvalidParameter(f"{self.place()} {key}", None, "given")
        return found

    def number(self, path: str, default: float = 0.0, most: float = MOST) -> float:
        """Returns the number at a path, or the default without it."""
        return float(self.numbers(path, 1, [default], most)[0])

    def known(self, path: str) -> float | None:
        """Returns the number at a path, None without it."""
        return self.number(path) if self.value(path) is not None else None

    def numbers(self, path: str = "", count: int | None = None, default: object = None,
                most: float = MOST) -> np.ndarray:
        """Returns the numbers at a path, or in the element itself: so many, or any number of them.

        Without a default they have to be there.
        """
        key, text = f"{self.place()} {path}".strip(), self.value(path) if path else self.text
        self.used |= not path
        if text is None:
            require(default is not None, key, None,
                    f"given, {'one number' if count == 1 else f'{count} numbers'}")
            return np.array(default, dtype=float)
        allowed = f"{'numbers' if count is None else count} of plain digits, with blanks between " \
            "them and a point for the decimals" if count != 1 else "one number, with a point"
        if "${" in text or "$(" in text:
            raise InvalidParameter(key, text.strip(), "a number: xacro has to be run first")
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            raise InvalidParameter(key, text.strip(), allowed) from None
        require(count is None or len(values) == count, key, text.strip(), allowed)
        require(bool(np.all(np.abs(values) <= most)), key, text.strip(),
                f"{allowed}, none beyond {most:g}")
        return values

    def pose(self) -> RigidTransform:
        """Returns the pose in its `<origin>` (URDF) or `<pose>` (SDFormat); none is the identity.

        Angles are (roll, pitch, yaw) [rad].
        """
        if (origin := self.find("origin")) is not None:
            xyz, rpy = (origin.numbers(key, 3, np.zeros(3)) for key in ("xyz", "rpy"))
            return RigidTransform(RollPitchYaw(rpy), xyz)
        place = self.find("pose")
        if place is None or not place.text.strip():
            return RigidTransform()
        if place.attributes.get("rotation_format") == "quat_xyzw":
            values = place.numbers(count=7)
            wxyz = values[[6, 3, 4, 5]]
            return RigidTransform(Quaternion(wxyz / np.linalg.norm(wxyz)), values[:3])
        values = place.numbers(count=6)
        unit = np.pi / 180.0 if place.is_true("degrees") else 1.0
        return RigidTransform(RollPitchYaw(unit * values[3:]), values[:3])

    def place(self) -> str:
        """Returns file, line and tag, for the key of an error."""
        named = f" name={self.attributes['name']!r}" if "name" in self.attributes else ""
        return f"{self.file}: line {self.line}: <{self.tag}{named}>"


def _words(text: str) -> str:
    """Returns a text with all its numbers written in one way."""
    return " ".join(repr(float(word) + 0.0) if NUMBER.fullmatch(word) else word
                    for word in text.split())


def element(tag: str, line: int, values: dict[str, object], urdf: bool) -> Node:
    """Returns an element with values as attributes (URDF) or as elements of their own (SDFormat).

    Numbers are written to the last digit.
    """
    texts = {key: " ".join(map(repr, np.ravel(np.asarray(value, dtype=float)).tolist()))
             for key, value in values.items()}
    if urdf:
        return Node(tag, line, texts)
    return Node(tag, line, children=[Node(key, line, text=text) for key, text in texts.items()])


def read_xml(text: str, file: Path) -> Node:
    """Returns the outermost element of a text.

    Args:
        text: XML, of which comments and processing instructions are left out.
        file: That it is from.

    Raises:
        InvalidFile: It is no XML; names the line.
    """
    top = Node("", 1)
    open_nodes = [top]

    def begin(tag: str, attributes: dict[str, str]) -> None:
        node = Node(tag, parser.CurrentLineNumber, dict(attributes), file=file)
        open_nodes[-1].children.append(node)
        open_nodes.append(node)

    def end(tag: str) -> None:
        open_nodes.pop()

    def data(part: str) -> None:
        open_nodes[-1].text += part

    parser = expat.ParserCreate("utf-8")
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.CharacterDataHandler = data
    try:
        parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        raise InvalidFile([f"{file}: line {error.lineno}: must be XML: "
                           f"{expat.ErrorString(error.code)}"]) from None
    return top.children[0]


def write_xml(root: Node) -> str:
    """Returns an element as text, every element in its line."""
    parts: list[str] = []
    line = 1

    def put(node: Node) -> None:
        nonlocal line
        parts.append("\n" * (node.line - line))
        line = max(line, node.line)
        given = "".join(f" {name}={quoteattr(value)}" for name, value in node.attributes.items())
        parts.append(f"<{node.tag}{given}>{escape(' '.join(node.text.split()))}")
        for child in node.children:
            put(child)
        parts.append(f"</{node.tag}>")

    put(root)
    return "".join(parts)
