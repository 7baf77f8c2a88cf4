"""Check of a URDF or SDFormat file against the elements that it may have.

Drake's parsers take a default for an element whose name is mistyped, the first of two that stand
for the same, and of `1,5` the 1. All these are mistakes here. A robot's own file has no elements
but those that are read, or they are reported; a file of others has elements of many programs.
"""

import difflib
import math
import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field

from uvms_drake.common.errors import InvalidFile
from uvms_drake.common.schema import suggestion
from uvms_drake.model.description.elements import (
    REFUSED,
    SDFORMAT,
    URDF,
    Element,
    Value,
    kind_of,
    spec_of,
)
from uvms_drake.model.description.hydrodynamics_file import FARTHEST
from uvms_drake.model.description.xml_tree import MOST, NUMBER, Node

INFINITE = re.compile(r"[-+]?inf(inity)?", re.IGNORECASE)
DEGREES = 2.0 * math.pi
"""Size of an angle of a pose from which it is taken for degrees [rad]."""
NARROW = 5e-3
"""Range of a joint in which no posture can be held [rad, m]."""
NESTED = "merged: nested models are refused: <include merge=\"true\">, or all links in one model"
"""Rule for a model within a model."""
UNCHECKED = ("material", "transmission")
"""Elements of files of others that have many forms: numbers in them are checked when read."""
LIKE = {False: 0.6, True: 0.8}
"""Likeness from which a name is another one, mistyped: in a robot's own file, in one of others."""
FORGIVEN = {"limit", "dynamics"}
"""Elements of a joint whose mistakes lose nothing where it is fixed."""
LISTED = 4
"""Number of lines or names that a note gives before it only counts."""


@dataclass
class Findings:
    """Complaints about a file, and notes on it."""

    complaints: list[str] = field(default_factory=list)
    """Each with its line."""
    unread: dict[str, list[int]] = field(default_factory=lambda: defaultdict(list))
    """Lines of the elements that are not read, by their name."""
    notes: list[str] = field(default_factory=list)
    foreign: bool = False
    """Whether the file is one of others: nothing is taken out of it."""
    joint: Node | None = None
    """The joint that is being checked."""

    def refuse(self, node: Node, owner: str, key: str, value: object, allowed: str,
               meant: str = "") -> None:
        """Adds a complaint about an element of a link, joint or frame, the owner.

        Args:
            node: The element.
            owner: Kind and name of the link, joint or frame.
            key: Path in that.
            value: Value that is there.
            allowed: Values that may be.
            meant: Name of the element that is mistyped.
        """
        place = ": ".join(part for part in (owner, key) if part)
        said = " ".join(value.split()) if isinstance(value, str) else value
        given = "" if value is None else f" = {said!r}"
        spared = self.foreign and self.joint is not None and FORGIVEN & {*key.split("."), meant}
        (self.joint.mistakes if spared and self.joint else self.complaints).append(
            f"line {node.line}: {place}{given}: must be {allowed}")


def check_description(root: Node, kind: str) -> Findings:
    """Returns the findings on a file, and removes the elements that are not read.

    Args:
        root: Of the file; changed.
        kind: "urdf" or "sdf".
    """
    table, found = (URDF if kind == "urdf" else SDFORMAT), Findings()
    outermost = "robot" if kind == "urdf" else "sdf"
    if root.tag != outermost:
        found.refuse(root, "", "the file", f"<{root.tag}>", f"a {kind.upper()} file, <{outermost}>")
        return found
    _check(root, table, table[outermost], "", "", found)
    if not found.complaints:
        for joint in root.walk():
            if joint.tag == "joint" and "type" in joint.attributes:
                _check_joint(joint, kind, found)
    return found


def check_foreign(node: Node, kind: str) -> None:
    """Raises for the first mistake in a model of others, an element with all below it.

    Raises:
        InvalidFile: A name is mistyped, an element is there twice, or a text is no number.
    """
    table, found = (URDF if kind == "urdf" else SDFORMAT), Findings(foreign=True)
    _check(node, table, table[node.tag], "", "", found)
    if found.complaints:
        raise InvalidFile([f"{node.file}: {each}" for each in found.complaints])


def _check(node: Node, table: dict[str, Element], spec: Element, owner: str, path: str,
           found: Findings) -> None:
    """Checks an element by its `spec` and all below it."""
    owned = node.tag in ("link", "joint", "frame") and "name" in node.attributes
    if owned:
        owner, path = f"{node.tag} {node.attributes['name']}", ""
        found.joint = node if node.tag == "joint" else None
    _check_attributes(node, spec, owner, path, found)
    # Children that are read, those left to Drake, and those that are reported or refused.
    children, seen = [], dict[str, Node]()
    once, many = spec.once.split(), spec.many.split()
    for child in node.children:
        key = f"{path}.{child.tag}".strip(".")
        within = found.foreign and child.tag in table and child.tag not in UNCHECKED
        if child.tag in once or (within if found.foreign else child.tag in many):
            first = seen.setdefault(child.tag, child)
            if child.tag in once and first is not child:
                found.refuse(child, owner, key, None, f"there once, and is in line {first.line}")
                continue
            if within or not found.foreign:
                _check(child, table, spec_of(table, node.tag, child.tag), owner, key, found)
            children.append(child)
        elif child.tag.startswith("xacro:"):
            found.refuse(child, owner, key, None, "expanded: by the program xacro, to a URDF")
        elif child.tag in spec.kept.split():
            children.append(child)
        elif child.tag in REFUSED and not found.foreign:
            found.refuse(child, owner, key, None, REFUSED[child.tag])
        elif child.tag in ("model", "include") and not found.foreign:
            found.refuse(child, owner, key, child.attributes.get("name"), NESTED)
        elif child.tag not in spec.quiet.split():
            _leave_out(child, child.tag, spec, owner, path, found)
    # Required elements, and the text between the tags.
    for name in spec.needs.split():
        spared = found.foreign and (node.tag in ("visual", "collision") or node.is_true("auto"))
        if name not in seen and name not in node.attributes and not spared:
            found.refuse(node, owner, f"{path}.{name}".strip("."), None, "there")
    if spec.text is not None:
        _check_value(node, node.text, spec.text, owner, path or node.tag, found)
    elif node.text.strip() and not found.foreign:
        found.refuse(node, owner, path or node.tag, node.text, "without text")
    if not found.foreign:
        node.children, node.text = children, "" if spec.text is None else node.text


def _check_attributes(node: Node, spec: Element, owner: str, path: str, found: Findings) -> None:
    """Checks the attributes of an element and takes away those that are not read."""
    kept, known = {}, spec.attributes.split()
    for name, text in node.attributes.items():
        key = f"{path}.{name}".strip(".")
        if name in known:
            _check_value(node, text, kind_of(node.tag, name), owner, key, found)
        elif name.split(":")[0] != "xmlns":
            _leave_out(node, name, spec, owner, path, found)
            continue
        kept[name] = text
    if not found.foreign:
        node.attributes = kept


def _leave_out(node: Node, name: str, spec: Element, owner: str, path: str, found: Findings
               ) -> None:
    """Reports an element or attribute that is not read, or refuses one that is mistyped."""
    key = f"{path}.{name}".strip(".")
    known = " ".join([spec.attributes, spec.once, spec.many, spec.unread]).split()
    others = [*known, *spec.quiet.split(), *REFUSED] if found.foreign else spec.unread.split()
    close = difflib.get_close_matches(name, known, 1, LIKE[found.foreign])
    if name in others:
        within = owner.split(" ")[0] or "the model"
        found.unread[f"{name} of {within}"].append(node.line)
    elif close:
        found.refuse(node, owner, key, None, f"one of {', '.join(known)} (did you mean "
                     f"'{close[0]}'?)", close[0])
    else:
        found.unread[f"{name}, which is unknown here"].append(node.line)


def _check_value(node: Node, text: str, value: Value, owner: str, key: str, found: Findings
                 ) -> None:
    """Checks an attribute or the text of an element."""
    # Words and names.
    words = text.split()
    if value.words:
        if text.strip() not in value.words and not found.foreign:
            found.refuse(node, owner, key, text, f"one of {', '.join(value.words)}"
                         + suggestion(text.strip(), list(value.words)))
        return
    if value.numbers == 0:
        if not words and not (found.foreign and node.tag in ("visual", "collision")):
            found.refuse(node, owner, key, text, "there: it is empty")
        return
    # Numbers: as many as there are to be, in full.
    count = value.numbers
    pose = node.tag == "pose"
    if pose and not words:
        return
    if pose and node.attributes.get("rotation_format") == "quat_xyzw":
        count = 7
    single = found.foreign and key.endswith("scale")  # Of all axes.
    good = (len(words) == count or (single and len(words) == 1)) and all(
        NUMBER.fullmatch(word) or (value.infinite and INFINITE.fullmatch(word)) for word in words)
    if not good:
        many = "a number" if count == 1 else f"{count} numbers with spaces between them"
        hint = ", decimals after a point" if "," in text else (
            ": xacro has to be run first" if "${" in text or "$(" in text else "")
        found.refuse(node, owner, key, text, many + hint)
        return
    # Sizes that can be, in the units of the format.
    numbers = [float(word) for word in words]
    if max(map(abs, numbers)) > MOST and not value.infinite:
        found.refuse(node, owner, key, text, f"{MOST:g} at most")
    if value.positive and min(numbers) <= 0.0:
        found.refuse(node, owner, key, text, "positive")
    if found.foreign:  # Its world may be large, and its angles may go round.
        return
    if value.length and (off := math.hypot(*numbers[:3])) > FARTHEST:
        found.refuse(node, owner, key, text, f"in metres and within {FARTHEST:g} m: it is "
                     f"{off:.4g} m away, as a number in millimetres may be")
    angles = numbers[3:] if pose and count == 6 and node.attributes.get("degrees") not in (
        "true", "1") else numbers if key.endswith("rpy") else numbers[:0]
    if any(abs(angle) > DEGREES for angle in angles):
        found.refuse(node, owner, key, text, "angles in radians, within ±2π: these may be degrees")


def _check_joint(joint: Node, kind: str, found: Findings) -> None:
    """Checks the limits of a joint that moves, and removes those without a meaning."""
    # Where the two formats have it.
    name, form = f"joint {joint.attributes['name']}", joint.attributes["type"]
    axis = joint if kind == "urdf" else joint.find("axis") or Node("axis", joint.line)
    limit = axis.find("limit") or joint
    bounds = [float(text) for key in ("lower", "upper") if (text := axis.value(f"limit/{key}"))]
    if form == "fixed":
        return
    # Limits that the joint can have; Drake ends the program for those that cross.
    if kind == "sdf" and not axis.children:
        found.refuse(joint, name, "axis", None, "there, as the joint moves")
    if form == "continuous" and bounds:
        if any(map(math.isfinite, bounds)):
            found.refuse(limit, name, "limit", bounds, "without lower and upper: a joint "
                         "of type continuous turns for ever; one with limits is revolute")
    elif len(bounds) == 1:
        if kind == "urdf":  # Where the format takes 0 for the other one, and Drake none.
            found.refuse(limit, name, "limit", bounds, "lower and upper, or none of them")
    elif bounds and bounds[0] == bounds[1]:
        found.refuse(limit, name, "limit", bounds, "a range: lower is upper, and the "
                     "joint cannot move: type fixed, or give limits")
    elif bounds and bounds[0] > bounds[1]:
        found.refuse(limit, name, "limit", bounds, "lower below upper")
    elif bounds and bounds[1] - bounds[0] < NARROW:
        found.refuse(limit, name, "limit", bounds, f"a range of {NARROW:g} or more, in "
                     "rad or m, or the joint of type fixed")
    # Friction is reported and taken out, or Drake would warn of it once more.
    if (dynamics := axis.find("dynamics")) is None:
        return
    if dynamics.number("damping") < 0.0:
        found.refuse(dynamics, name, "dynamics.damping", dynamics.value("damping"),
                     "zero or positive")
    if dynamics.number("friction") != 0.0:
        found.unread["friction of joint (a scenario has model_error.joint_friction)"].append(
            dynamics.line)
    dynamics.attributes.pop("friction", None)
    dynamics.children = [child for child in dynamics.children if child.tag != "friction"]


def unread_notes(found: Findings) -> Iterator[str]:
    """Yields a sentence for each kind of element that is not read."""
    for name, lines in found.unread.items():
        listed = ", ".join(map(str, lines[:LISTED])) + (
            f" and {len(lines) - LISTED} more" if len(lines) > LISTED else "")
        yield f"{'lines' if len(lines) > 1 else 'line'} {listed}: not read: {name}"
