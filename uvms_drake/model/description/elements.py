"""The elements of URDF and SDFormat that a robot's file may have, and those that are not read.

elements.yaml has a table of each format, in which an element is named by its tag, or by that of its
parent and its own where a tag has two meanings. An element in neither table is unknown.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from uvms_drake.common.schema import read_yaml


@dataclass(frozen=True)
class Value:
    """The kind of a text: numbers, words of a list, or any text."""

    numbers: int = 0
    """Count of numbers, separated by spaces; 0: it is no number."""
    infinite: bool = False
    """Whether a number may be infinite."""
    words: tuple[str, ...] = ()
    """All that are allowed; empty: any."""
    length: bool = False
    """Whether the numbers are a place [m]: the first three, of which none is far away."""
    positive: bool = False
    """Whether the numbers are sizes."""


@dataclass(frozen=True)
class Element:
    """Names of the children and attributes of an element, separated by spaces."""

    attributes: str = ""
    values: str = ""
    """Numbers in it: attributes of URDF, elements of SDFormat."""
    once: str = ""
    """Children that are there once at most."""
    many: str = ""
    """Children that may be there several times."""
    needs: str = ""
    """Attributes, values and children that must be there."""
    unread: str = ""
    """Children and attributes with a meaning elsewhere, which are reported as not read."""
    quiet: str = ""
    """Elements about looks or contact of shapes: nothing here depends on them."""
    kept: str = ""
    """Children that are left to Drake as they are, with all below them: forces and constraints,
    each of which is refused once it is in the plant."""
    text: Value | None = None
    """Its own text, in the file the name of its kind; None: it has none."""


def _by_name(table: Any) -> dict[str, Any]:
    """Returns the entries of a table, in which several names may have one."""
    return {name: entry for names, entry in table.items() for name in names.split(", ")}


_DATA: Any = read_yaml(Path(__file__).with_name("elements.yaml"))
TEXT = Value()
VALUES = {name: replace(value, words=tuple(value.words)) for name, value in _by_name(
    {names: Value(**fields) for names, fields in _DATA["values"].items()}).items()}
"""Kinds of texts by the name of the attribute or element, or by that of its parent, too; all
others are any text."""
REFUSED: dict[str, str] = _DATA["refused"]
"""Elements that would change the robot and that Drake or this project does not take, by tag."""


def _elements(kind: str) -> dict[str, Element]:
    """Returns the elements of a format, and those of both."""
    return {tag: Element(**fields | {"text": VALUES.get(fields["text"], TEXT)}
                         if "text" in fields else fields)
            for tag, fields in _by_name(_DATA["both"] | _DATA[kind]).items()}


URDF = {tag: replace(spec, attributes=f"{spec.attributes} {spec.values}".strip())
        for tag, spec in _elements("urdf").items()}
_SDF = _elements("sdf")
SDFORMAT = {name: Element(text=VALUES.get(name, TEXT)) for spec in _SDF.values()
            for name in spec.values.split()} | {
    tag: replace(spec, once=f"{spec.values} {spec.once}".strip()) for tag, spec in _SDF.items()}
for _table in (URDF, SDFORMAT):
    _table["collision"] = _table["visual"]  # Read of files of others only.


def kind_of(parent: str, name: str) -> Value:
    """Returns the kind of an attribute or of the text of an element."""
    return VALUES.get(f"{parent} {name}", VALUES.get(name, TEXT))


def spec_of(table: dict[str, Element], parent: str, tag: str) -> Element:
    """Returns the element of a table by its tag and that of its parent."""
    return table.get(f"{parent} {tag}", table[tag])
