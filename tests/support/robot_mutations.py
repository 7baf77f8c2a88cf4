"""Files of a robot with one random mistake in an element, a key or a number."""

import random
import re
import shutil
from copy import deepcopy
from pathlib import Path
from xml.etree import ElementTree

VALUE = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
SCALES = (1000.0, 1e-3, -1.0, 57.29577951, 10.0)


def mutated(source: Path, folder: Path, rng: random.Random) -> tuple[Path, str]:
    """Returns a copy of a robot's folder in `folder` with a mistake, and what that is."""
    robot = folder / source.name
    shutil.copytree(source, robot)
    files = [path for path in sorted(robot.iterdir()) if path.suffix in (".sdf", ".urdf", ".yaml")]
    file = rng.choice(files)
    text = file.read_text(encoding="utf-8")
    text, specification = (_yaml if file.suffix == ".yaml" else mutated_xml)(text, rng)
    file.write_text(text, encoding="utf-8")
    return robot, f"{file.name}: {specification}"


def mistyped(word: str, rng: random.Random) -> str:
    """Returns a word with a letter dropped, doubled, swapped with the next one or replaced."""
    i = rng.randrange(len(word))
    return rng.choice([
        word[:i] + word[i + 1:], word[: i + 1] + word[i:],
        word[:i] + word[i + 1: i + 2] + word[i] + word[i + 2:],
        word[:i] + rng.choice("abcxyz019_") + word[i + 1:]])


def _scaled(text: str, rng: random.Random) -> str:
    """Returns a text with one of its numbers scaled, or written with a comma."""
    found = list(VALUE.finditer(text))
    if not found:
        return mistyped(text, rng) if text.strip() else "0"
    number = rng.choice(found)
    new = repr(rng.choice(SCALES) * float(number[0]))
    if rng.random() < 0.25:
        new = number[0].replace(".", ",") if "." in number[0] else f"{number[0]},"
    return text[: number.start()] + new + text[number.end():]


def mutated_xml(text: str, rng: random.Random) -> tuple[str, str]:
    """Returns a URDF or SDFormat text with a mistake."""
    text = text.replace("drake:", "drake__")  # A prefix that ElementTree does not resolve.
    root = ElementTree.fromstring(text)
    above = {child: parent for parent in root.iter() for child in parent}
    node = rng.choice([each for each in root.iter() if each is not root])
    siblings = above[node]
    kind = rng.choice(["drop", "double", "swap", "scale", "scale", "mistype", "attribute"])
    specification = f"{kind} <{node.tag} {node.attrib}> in <{siblings.tag} {siblings.attrib}>"
    if kind == "drop":
        siblings.remove(node)
    elif kind == "double":
        twin = deepcopy(node)
        for name in list(twin.attrib):
            twin.set(name, _scaled(twin.get(name), rng) if VALUE.search(twin.get(name))
                     else twin.get(name))
        if rng.random() < 0.3 and "name" in twin.attrib:
            twin.set("name", twin.get("name") + "_2")
        siblings.insert(list(siblings).index(node), twin)
    elif kind == "swap":
        other = rng.choice(list(root.iter(node.tag)))
        node.text, other.text = other.text, node.text
        node.attrib, other.attrib = dict(other.attrib), dict(node.attrib)
    elif kind == "mistype":
        node.tag = mistyped(node.tag, rng)
    elif node.attrib:
        name = rng.choice(sorted(node.attrib))
        value = node.attrib.pop(name)
        if kind == "scale":
            node.set(name, _scaled(value, rng))
        elif rng.random() < 0.6:  # Else it is dropped.
            node.set(mistyped(name, rng), value)
        specification += f", {name}"
    else:
        node.text = _scaled(node.text or "", rng)
    try:
        out = ElementTree.tostring(root, encoding="unicode")
    except (TypeError, ValueError):  # A tag without a letter.
        out = text
    out = out.replace("drake__", "drake:")
    return re.sub(r"<([^>]*?)xmlns:ns\d+=\"[^\"]*\"", r"<\1", out), specification


def _yaml(text: str, rng: random.Random) -> tuple[str, str]:
    """Returns a YAML text with a mistake in one of its lines."""
    lines = text.splitlines()
    places = [i for i, line in enumerate(lines) if line.split("#")[0].strip()]
    i = rng.choice(places)
    kind = rng.choice(["drop", "double", "swap", "scale", "scale", "mistype"])
    specification = f"{kind} line {i + 1}: {lines[i].strip()}"
    if kind == "drop":
        del lines[i]
    elif kind == "double":
        lines.insert(i, lines[i])
    elif kind == "swap":
        j = rng.choice(places)
        lines[i], lines[j] = lines[j], lines[i]
    elif kind == "scale":
        head, mark, tail = lines[i].partition("#")
        lines[i] = _scaled(head, rng) + mark + tail
    else:
        words = list(re.finditer(r"\w+", lines[i].split("#")[0]))
        if words:
            word = rng.choice(words)
            lines[i] = lines[i][: word.start()] + mistyped(word[0], rng) + lines[i][word.end():]
    return "\n".join(lines) + "\n", specification
