"""Elements of an XML file that know their file and line, and read the numbers in them."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from uvms_drake.common.errors import InvalidParameter, require
from uvms_drake.model.description import xml_tree

MOST = 1e9
"""Size of a number from which it is none of a robot's."""


@dataclass
class Node:
    """An element of an XML file."""

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    text: str = ""
    children: list["Node"] = field(default_factory=list)

    def find(self, path: str) -> "Node | None":
        """Returns the element at a path of tags, such as `geometry/box`; None without it.

        Raises:
            InvalidParameter: It is there twice.
        """
        found = list(self.all(path))
        require(len(found) < 2, self.place(), path,
                f"there once: lines {', '.join(str(node.line) for node in found)}")
        return found[0] if found else None

    def all(self, path: str) -> Iterator["Node"]:
        """Yields the elements at a path of tags."""
        tag, _, rest = path.partition("/")
        for child in self.children:
            if child.tag == tag:
                if rest:
                    yield from child.all(rest)
                else:
                    yield child

    def every(self, tag: str) -> Iterator["Node"]:
        """Yields the elements of this tag at any depth."""
        for child in self.children:
            if child.tag == tag:
                yield child
            yield from child.every(tag)

    def name(self) -> str:
        """Returns the attribute `name`, or raises."""
        return self.attribute("name")

    def attribute(self, key: str) -> str:
        """Returns an attribute that has to be there."""
        found = self.attributes.get(key, "").strip()
        require(bool(found), f"{self.place()} {key}", None, "given")
        return found

    def words(self, path: str) -> str | None:
        """Returns the text of an element, None without it."""
        node = self.find(path)
        return None if node is None else node.text.strip()

    def number(self, path: str, default: float | None = None, most: float = MOST) -> float | None:
        """Returns the number in an element, or the default without it."""
        node = self.find(path)
        return default if node is None else float(node.numbers(1, most)[0])

    def numbers(self, count: int | None, most: float = MOST) -> np.ndarray:
        """Returns the numbers of this element's text: so many, or any number of them."""
        return self._parse(f"{self.place()}", self.text, count, most)

    def numbers_of(self, key: str, count: int, default: object = None, most: float = MOST
                   ) -> np.ndarray:
        """Returns the numbers of an attribute, or the default without it."""
        if key not in self.attributes:
            require(default is not None, f"{self.place()} {key}", None,
                    "given, one number" if count == 1 else f"given, {count} numbers")
            return np.array(default, dtype=float)
        return self._parse(f"{self.place()} {key}", self.attributes[key], count, most)

    def place(self) -> str:
        """Returns file, line and tag, for the key of an error."""
        named = f" name={self.attributes['name']!r}" if "name" in self.attributes else ""
        return f"{self.file}: line {self.line}: <{self.tag}{named}>"

    def _parse(self, key: str, text: str, count: int | None, most: float) -> np.ndarray:
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


def read_xml(file: Path) -> Node:
    """Returns the root element of an XML file.

    Raises:
        InvalidParameter: It cannot be read, or is no XML.
    """
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise InvalidParameter("--from", str(file),
                               f"a file that can be read ({error.strerror})") from None
    except ValueError:
        raise InvalidParameter("--from", str(file), "a text in UTF-8") from None
    return _node(xml_tree.read_xml(text, str(file)), file)


def _node(element: xml_tree.Node, file: Path) -> Node:
    return Node(element.tag, element.attributes, file, element.line, element.text,
                [_node(child, file) for child in element.children])
