"""XML with the line of every element, read and written so that the lines stay the same.

Prefixes such as `drake:` are parts of the names, whether they are declared or not, as they are to
Drake's parsers.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat
from xml.sax.saxutils import escape, quoteattr

from uvms_drake.common.errors import InvalidFile


@dataclass
class Node:
    """An element of XML."""

    tag: str
    line: int
    attributes: dict[str, str] = field(default_factory=dict)
    text: str = ""
    """All text between its tags that is in none of its children."""
    children: list["Node"] = field(default_factory=list)

    def find(self, *tags: str) -> "Node | None":
        """Returns the first child by a tag, and of that by the next one; None if it is not there.

        Args:
            tags: One or more.
        """
        node: Node | None = self
        for tag in tags:
            node = next((child for child in node.children if child.tag == tag), None) if (
                node is not None) else None
        return node

    def all(self, tag: str) -> "list[Node]":
        """Returns the children by a tag."""
        return [child for child in self.children if child.tag == tag]

    def walk(self) -> "Iterator[Node]":
        """Yields the element and all below it, in the order of the text."""
        waiting = [self]
        while waiting:
            node = waiting.pop()
            yield node
            waiting += node.children[::-1]


def read_xml(text: str, source: str) -> Node:
    """Returns the outermost element of a text.

    Args:
        text: XML, of which comments and processing instructions are left out.
        source: File that it is from, for the error.

    Raises:
        InvalidFile: It is no XML; names the line.
    """
    top = Node("", 1)
    open_nodes = [top]

    def begin(tag: str, attributes: dict[str, str]) -> None:
        node = Node(tag, parser.CurrentLineNumber, dict(attributes))
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
        raise InvalidFile([f"{source}: line {error.lineno}: must be XML: "
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
