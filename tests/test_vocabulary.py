"""The words of the code: docstrings that say what a thing is or does, in the glossary's terms."""

import ast
import re
from collections.abc import Iterator
from io import StringIO
from itertools import pairwise
from pathlib import Path
from tokenize import COMMENT, generate_tokens

import pytest
from support.pages import PACKAGE

FILES = sorted(PACKAGE.rglob("*.py"))
GLOSSARY = (PACKAGE / "glossary.md").read_text(encoding="utf-8")
HEADLESS = ("What", "How", "Where", "From", "Who")
HEADLESS_FIELD = (*HEADLESS, "Of", "Those")
LONGEST_DOCSTRING = 20  # Lines of a module's.
LONGEST_BODY = 30  # Lines without a comment.
MOST_ENTRIES = 16


def retired() -> dict[str, str]:
    """Returns the retired words of the glossary, and the term that replaces each."""
    section = GLOSSARY.split("## Retired words")[1].split("\n## ")[0]
    rows = re.findall(r"^\| `([^|]+)` \| ([^|]+) \|", section, re.MULTILINE)
    return {word: term for words, term in rows for word in re.findall(r"\w+", words)}


RETIRED = retired()
EXEMPT = {"loads"}
"""Identifiers with a retired word: that of `json`."""


def parsed(path: Path) -> ast.Module:
    """Returns the syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


def documented(tree: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """Yields every module, class and function with its docstring."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and (
                text := ast.get_docstring(node)):
            yield node, text


def docstring_nodes(tree: ast.AST) -> set[int]:
    """Returns the ids of the constants that are docstrings, of fields too."""
    return {id(node.value) for node in ast.walk(tree)
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)}


def field_docs(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yields the docstrings of fields and of constants, with their lines."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(node, ast.Module | ast.ClassDef) or not isinstance(body, list):
            continue
        for before, after in pairwise(body):
            if (isinstance(before, ast.Assign | ast.AnnAssign) and isinstance(after, ast.Expr)
                    and isinstance(after.value, ast.Constant)
                    and isinstance(after.value.value, str)):
                yield after.lineno, after.value.value


def words_of(identifier: str) -> set[str]:
    """Returns the words that an identifier is made of, in lower case."""
    return {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", identifier)}


def identifiers(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yields every name that a file defines or uses, with its line."""
    for node in ast.walk(tree):
        line = getattr(node, "lineno", 0)
        for key in ("id", "attr", "arg", "name", "module"):
            value = getattr(node, key, None)
            if isinstance(value, str) and not isinstance(node, ast.alias):
                yield line, value


def complain(found: list[str]) -> None:
    assert not found, "\n" + "\n".join(found)


ids = [str(path.relative_to(PACKAGE)) for path in FILES]


@pytest.mark.parametrize("path", FILES, ids=ids)
def test_a_docstring_begins_with_a_noun_or_a_verb(path):
    tree = parsed(path)
    found = [f"{path}:{getattr(node, 'lineno', 1)} {text.splitlines()[0]}"
             for node, text in documented(tree)
             if re.match(rf"({'|'.join(HEADLESS)})\b", text) or text.startswith("Returns what")]
    found += [f"{path}:{line} {text.splitlines()[0]}" for line, text in field_docs(tree)
              if re.match(rf"({'|'.join(HEADLESS_FIELD)})\b", text.strip())]
    complain(found)


@pytest.mark.parametrize("path", FILES, ids=ids)
def test_docstrings_and_comments_name_things_in_place_of_what(path):
    text, tree = path.read_text(encoding="utf-8"), parsed(path)
    docstrings = docstring_nodes(tree)
    docs = {node.lineno: node.value for node in ast.walk(tree)
            if isinstance(node, ast.Constant) and id(node) in docstrings}
    comments = {token.start[0]: token.string for token in generate_tokens(StringIO(text).readline)
                if token.type == COMMENT}
    complain([f"{path}:{line} {part}" for line, part in (docs | comments).items()
              if re.search(r"\bwhat\b", re.sub(r"`[^`]*`", "", str(part)), re.IGNORECASE)])


@pytest.mark.parametrize("path", FILES, ids=ids)
def test_no_retired_word_is_an_identifier_or_in_a_message(path):
    tree = parsed(path)
    found = [f"{path}:{line} {name}" for line, name in identifiers(tree)
             if name not in EXEMPT and not name.startswith("uvms_drake.")
             and words_of(name) & RETIRED.keys()]
    docs = docstring_nodes(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
            words = set(re.findall(r"[a-z]+", node.value.lower()))
            if words & MESSAGES:
                found.append(f"{path}:{node.lineno} {node.value!r}")
    complain(found)


MESSAGES = {"felt", "void", "nobody", "somebody", "told", "aside", "unmeasured"} & RETIRED.keys()
"""The retired words that have no other meaning in a sentence."""


@pytest.mark.parametrize("path", FILES, ids=ids)
def test_a_module_opens_with_code_and_not_with_a_proof(path):
    text = ast.get_docstring(parsed(path), clean=False) or ""
    assert text.count("\n") < LONGEST_DOCSTRING


@pytest.mark.parametrize("path", FILES, ids=ids)
def test_a_long_body_has_comments(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    found = []
    for node in ast.walk(parsed(path)):
        if not isinstance(node, ast.FunctionDef):
            continue
        body = node.body[1:] if ast.get_docstring(node) else node.body
        if not body:
            continue
        first, last = body[0].lineno, node.end_lineno
        if last - first + 1 >= LONGEST_BODY and not any(
                line.lstrip().startswith("#") for line in lines[first - 2:last]):
            found.append(f"{path}:{node.lineno} {node.name}: {last - first + 1} lines")
    complain(found)


@pytest.mark.parametrize(
    "folder", sorted({path.parent for path in FILES} - {PACKAGE}),
    ids=lambda folder: str(folder.relative_to(PACKAGE)))
def test_a_room_has_few_entries(folder):
    entries = {path.relative_to(folder).parts[0] for path in FILES
               if folder in path.parents and path.name != "__init__.py"}
    assert len(entries) <= MOST_ENTRIES


def test_every_name_of_the_glossary_is_in_the_code():
    """A term's name in the code, in backticks in the glossary's table, is an identifier there."""
    used = {name for path in FILES for _, name in identifiers(parsed(path))}
    used |= {path.stem for path in FILES} | {path.parent.name for path in FILES}
    used |= {node.value for path in FILES for node in ast.walk(parsed(path))
             if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    table = GLOSSARY.split("## Retired words")[0]
    names = {name for row in re.findall(r"^\|[^|]*\|[^|]*\|([^|]*)\|", table, re.MULTILINE)
             for cell in re.findall(r"`([^`]+)`", row) for name in re.findall(r"\w+", cell)}
    assert len(names) >= 50
    assert sorted(names - used) == []
