"""Theory pages: every link has its heading, every condition names the theorem that needs it."""

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from support.pages import PACKAGE, sections
from support.quick import FEW

from uvms_drake.certificate.assumptions import assumed_conditions
from uvms_drake.certificate.certificate import from_data, to_data
from uvms_drake.certificate.certify import certify
from uvms_drake.station.scenario.scenario import load_scenario

CODE = sorted(PACKAGE.rglob("*.py"))
PAGES = sorted(PACKAGE.rglob("theory.md"))
DOCUMENTS = sorted([*PACKAGE.rglob("*.md"), *PACKAGE.parent.glob("*.md")])
BELOW_PACKAGE = re.compile(r"(?<![\w/.(])((?:[\w-]+/)*theory\.md)#([\w-]+)")
"""A link in code: a path below the package and a heading."""
RELATIVE = re.compile(r"\]\(((?:[\w./-]*theory\.md)?)#([\w-]+)\)")
"""A link of a document, relative to it."""


def is_theorem(link: str) -> bool:
    """Returns whether a link below the package has its page and heading."""
    path, _, anchor = link.partition("#")
    page = PACKAGE / path
    return page in PAGES and anchor in sections(page, "##")


def conditions_of(path: Path) -> Iterator[ast.Call]:
    """Yields the calls that make a condition, but for those from data or from arguments."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if (isinstance(node, ast.Call)
                and getattr(node.func, "id", None) in ("Condition", "assumption")
                and all(keyword.arg is not None for keyword in node.keywords)
                and not any(keyword.arg == getattr(keyword.value, "id", None) == "theorem"
                            for keyword in node.keywords)):
            yield node


def constants_of(path: Path) -> dict[str, object]:
    """Returns the constants of a module by name, and those that it imports, or whose module."""
    found: dict[str, object] = {}
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("uvms_drake."):
            source = PACKAGE.parent / (str(node.module).replace(".", "/") + ".py")
            names = [alias.name for alias in node.names if alias.name.isupper()]
            if names and source.is_file():
                theirs = constants_of(source)
                found |= {name: theirs[name] for name in names if name in theirs}
            for alias in node.names:
                module = source.with_suffix("") / f"{alias.name}.py"
                if module.is_file():
                    found |= {f"{alias.asname or alias.name}.{name}": value
                              for name, value in constants_of(module).items()}
        elif isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant):
            found |= {target.id: node.value.value for target in node.targets
                      if isinstance(target, ast.Name)}
    return found


@pytest.mark.parametrize("path", CODE + DOCUMENTS, ids=lambda path: path.name)
def test_every_link_to_a_theorem_has_its_heading(path):
    text = path.read_text(encoding="utf-8")
    for match in BELOW_PACKAGE.finditer(text):
        assert is_theorem(match.group(0)), f"{path}: {match.group(0)}"
    for target, anchor in RELATIVE.findall(text) if path.suffix == ".md" else ():
        page = (path.parent / target).resolve() if target else path
        if page.name == "theory.md":
            assert anchor in sections(page, "##"), f"{path}: {target}#{anchor}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(PACKAGE)))
def test_every_theorem_says_what_it_states_and_what_is_estimated(page):
    found = sections(page, "##")
    assert len(found) == len(re.findall(r"^## ", page.read_text(encoding="utf-8"), re.MULTILINE))
    for anchor, section in found.items():
        assert "**What is estimated.**" in section, f"{page}#{anchor}"
        assert re.search(r"\*\*(Statement|Assumptions)\.\*\*", section), f"{page}#{anchor}"


def test_every_condition_of_the_package_names_a_theorem():
    count = 0
    for path in CODE:
        for call in conditions_of(path):
            where = f"{path}:{call.lineno}"
            theorem = {keyword.arg: keyword.value for keyword in call.keywords}.get("theorem")
            assert theorem is not None, where
            link = (theorem.value if isinstance(theorem, ast.Constant)
                    else constants_of(path).get(ast.unparse(theorem)))
            assert isinstance(link, str) and is_theorem(link), f"{where}: {link}"
            count += 1
    assert count > 40


@pytest.mark.parametrize("name", ["girona500_ideal", "girona500_contact"])
def test_assumptions_name_their_theorem(name):
    found = assumed_conditions(load_scenario(name))
    assert found and all(is_theorem(each.theorem) for each in found)


@pytest.mark.slow
def test_a_certificate_has_its_theorems_in_its_file(few_searches):
    certificate = certify(load_scenario("girona500_ideal", FEW))
    data = json.loads(json.dumps(to_data(certificate)))
    assert len(data["conditions"]) > 20
    assert all(is_theorem(each["theorem"]) for each in data["conditions"])
    assert from_data(data).conditions == certificate.conditions
