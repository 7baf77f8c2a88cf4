"""Makes dataclasses of raw YAML data, so that a mistake is reported by its key; writes them.

Drake's `yaml_load_typed` stops at the first mistake too, but names neither the path of the key nor,
for arrays and tags, the allowed values; it lets NaN and ragged arrays through, and knows no kinds
but those of a union. As there, a mapping changes only the fields of a default that it names.
`yaml_dump_typed` refuses an object whose type the field does not name, as one of a user's own.
"""

import contextlib
import dataclasses
import difflib
import math
import re
import textwrap
import types
import typing
from collections.abc import Callable, Collection, Sequence
from copy import deepcopy
from functools import lru_cache
from pathlib import Path

import numpy as np
import yaml  # type: ignore[import-untyped]  # Drake's own choice and dependency.
from pydrake.common.yaml import yaml_dump_typed

from uvms_drake.common.attribute_docs import attribute_docs
from uvms_drake.common.constraints import UnitVector
from uvms_drake.common.errors import InvalidFile, InvalidParameter, ScenarioError, require, within
from uvms_drake.common.kinds import kinds_of

T = typing.TypeVar("T")

NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")
KEPT = 16
"""Number of texts whose content is remembered: PyYAML takes longer than to build the rest of a
station, and the runs of a campaign read the same robot again and again."""
ROUNDED = 1e-6
"""Difference of a unit vector's length from 1 that is left as it is."""
LARGEST = 1e50
"""Largest number in a file: results such as its square are finite too."""


def read_yaml(path: Path) -> object:
    """Returns the raw data of a YAML file; a tag becomes the entry `_tag` of its mapping."""
    return parse_yaml(read_text(path))


def read_text(path: Path) -> str:
    """Returns the text of a file, or raises a `ScenarioError`."""
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise ScenarioError(f"cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ScenarioError("cannot be read: it is not UTF-8 text") from None


def parse_yaml(text: str) -> object:
    """Returns the raw data of a YAML text, or raises a `ScenarioError` that names the line."""
    try:
        return _parsed(text, _FastLoader)
    except ScenarioError:
        raise
    except Exception:  # libyaml's, whose messages are shorter, or Python's of no numbers.
        pass
    try:
        return _parsed(text, _Loader)
    except ScenarioError:
        raise
    except Exception as error:
        mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = getattr(error, "problem", None) or getattr(error, "context", None) or error
        raise ScenarioError(f"{where}{' '.join(str(problem).split())}") from None


def _parsed(text: str, kind: type[yaml.SafeLoader]) -> object:
    """Returns the raw data of a YAML text, after `_require_plain`."""
    loader = kind(text)
    try:
        node = loader.get_single_node()
        _require_plain(node)
        return None if node is None else loader.construct_document(node)
    finally:
        loader.dispose()


class _Loader(yaml.SafeLoader):
    """Reads a tag as the entry `_tag` of its mapping, as Drake's `yaml_load_data` does."""


class _FastLoader(getattr(yaml, "CSafeLoader", yaml.SafeLoader)):  # type: ignore[misc]
    """The same by libyaml where PyYAML has it, in a tenth of the time."""


def _tagged(loader: yaml.SafeLoader, tag: str, node: yaml.Node) -> object:
    return loader.construct_mapping(node) | {"_tag": tag}


for _kind in (_Loader, _FastLoader):
    _kind.add_multi_constructor("", _tagged)


def load_file(path: Path, schema: type[T]) -> T:
    """Returns the content of a YAML file as `schema`.

    Args:
        path: Of the file.
        schema: Dataclass of its content.

    Raises:
        InvalidFile: The file cannot be read, or a value in it has no meaning; names the line.
    """
    text = ""
    try:
        text = read_text(path)
        content: T = deepcopy(_content(schema, text))  # type: ignore[arg-type]  # It is hashable.
    except ScenarioError as error:
        raise InvalidFile([f"{path}: {error}"]) from None
    except InvalidParameter as error:
        line = line_of(text, error.key)
        raise InvalidFile([f"{path}: {f'line {line}: ' if line else ''}{error}"]) from None
    return content


@lru_cache(maxsize=KEPT)
def _content(schema: type, text: str) -> typing.Any:
    return load_typed(schema, parse_yaml(text))


def line_of(text: str, key: str) -> int | None:
    """Returns the line of a YAML text with the value of a dotted key, or with its nearest parent.

    None, if the text has nothing of it.
    """
    node, line = yaml.compose(text, Loader=yaml.SafeLoader), None
    while isinstance(node, yaml.CollectionNode):
        entries = [(str(name.value), name, value) for name, value in node.value] if isinstance(
            node, yaml.MappingNode) else [
            (f"[{i}]", item, item) for i, item in enumerate(node.value)]
        matching = [entry for entry in entries
                    if key == entry[0] or key.startswith((f"{entry[0]}.", f"{entry[0]}["))]
        if not matching:
            break
        head, start, node = max(matching, key=lambda entry: len(entry[0]))
        key, line = key[len(head):].removeprefix("."), start.start_mark.line + 1
    return line


def _require_plain(root: yaml.Node | None) -> None:
    """Raises for texts that YAML 1.1 silently reads otherwise than people do.

    A key that a mapping has twice, of which PyYAML takes the last; and a number that is not
    decimal: 010 is eight, and 1:30 is ninety.
    """
    waiting, seen = [root], set()
    while waiting:
        node = waiting.pop()
        if isinstance(node, yaml.ScalarNode) and node.tag in NUMBERS and (
                ":" in node.value or re.match(r"[-+]?0[0-9_]", node.value)):
            raise ScenarioError(f"line {node.start_mark.line + 1}: {node.value} is not decimal in "
                                "YAML; it must be without zeros in front, and without colons")
        if id(node) in seen or not isinstance(node, yaml.CollectionNode):
            continue
        seen.add(id(node))  # An alias is the node that it stands for, and can be within itself.
        if isinstance(node, yaml.SequenceNode):
            waiting += node.value
            continue
        keys: dict[object, yaml.Node] = {}
        for key, value in node.value:
            first = keys.setdefault(key.value if isinstance(key, yaml.ScalarNode) else key, key)
            if first is not key:
                raise ScenarioError(f"line {key.start_mark.line + 1}: the key {key.value!r} is "
                                    f"there already, in line {first.start_mark.line + 1}")
            waiting.append(value)


def load_typed(schema: type[T], raw: object) -> T:
    """Returns raw YAML data as an instance of `schema`, with values that it allows.

    Args:
        schema: A dataclass or one of Drake's config structs, which can be made without arguments.
        raw: A mapping, as of `parse_yaml`.

    Raises:
        InvalidParameter: An unknown key or tag, a value of the wrong type, or one not allowed.
    """
    typed: T = conform(schema, raw)
    check_values(typed)
    return typed


def check_values(struct: object, key: str = "") -> None:
    """Raises `InvalidParameter` for the first value in a struct that its schema does not allow.

    First come the constraints of its fields, see `constraints`, and those of the structs in them,
    where unit vectors that are rounded get length 1; then its own `check`, of several fields
    together.

    Args:
        struct: A dataclass, or one of Drake's config structs.
        key: Its dotted path, for the error.
    """
    fields = _annotated(type(struct))  # type: ignore[arg-type]  # It is hashable.
    for name, declared in fields.items():
        value = getattr(struct, name)
        _check_value(declared, value, f"{key}.{name}" if key else name)
        if UnitVector in typing.get_args(declared) and value is not None:
            norm = float(np.linalg.norm(value))
            if abs(norm - 1.0) > ROUNDED:
                object.__setattr__(struct, name, np.asarray(value, dtype=float) / norm)
    if hasattr(struct, "check"):
        with within(key) if key else contextlib.nullcontext():
            struct.check()


def checked(struct: T) -> T:
    """Returns a dataclass with values that its schema allows, those of arrays as arrays of floats.

    Raises:
        InvalidParameter: As of `check_values`.
    """
    check_values(struct)
    return _with_arrays(struct)


def _with_arrays(struct: typing.Any) -> typing.Any:
    arrays: dict[str, object] = {}
    for name, kind in field_types(type(struct)).items():
        value = getattr(struct, name)
        if kind is np.ndarray:
            arrays[name] = np.array(value, dtype=float)
        elif dataclasses.is_dataclass(value):
            arrays[name] = _with_arrays(value)
    return dataclasses.replace(struct, **arrays)


def _check_value(declared: typing.Any, value: typing.Any, key: str) -> None:
    """Raises `InvalidParameter` for a field's value, by its declared type."""
    if value is None and _is_union(declared):
        return
    for option in typing.get_args(declared) if _is_union(declared) else (declared,):
        if typing.get_origin(option) is typing.Annotated:
            inner, *constraints = typing.get_args(option)
            for constraint in constraints:
                constraint.check(key, value)
            _check_value(inner, value, key)
        elif typing.get_origin(option) is list:
            if not isinstance(value, Sequence):
                raise InvalidParameter(key, value, "a list")
            for i, item in enumerate(value):
                _check_value(typing.get_args(option)[0], item, f"{key}[{i}]")
        elif typing.get_origin(option) is dict:
            for name, item in value.items():
                _check_value(typing.get_args(option)[1], item, f"{key}.{name}")
    if _is_struct(value):
        check_values(value, key)


@lru_cache
def _annotated(schema: type) -> dict[str, typing.Any]:
    """Returns the type of each field of a struct, with its constraints."""
    types_of = typing.get_type_hints(schema, include_extras=True) if (
        dataclasses.is_dataclass(schema)) else {}
    return {name: types_of.get(name, plain) for name, plain in field_types(schema).items()}


def conform(schema: typing.Any, value: object, key: str = "", default: object = None
            ) -> typing.Any:
    """Returns raw data as a value of the schema's type.

    Args:
        schema: A dataclass, one of Drake's config structs, or the type of one of their fields.
        value: Raw YAML data.
        key: Dotted path of `value`, for the error.
        default: Value of which a mapping changes only a part; None: that of the type.

    Raises:
        InvalidParameter: As of `load_typed`.
    """
    kinds, is_optional = _choices(schema)
    if value is None and is_optional:
        return None
    if len(kinds) > 1:
        return _conform_choice(kinds, value, key, default)
    (kind,) = kinds
    if kind in _LEAVES:
        return _LEAVES[kind](value, key)
    if typing.get_origin(kind) is list:
        (item,) = typing.get_args(kind)
        if not isinstance(value, list):
            raise InvalidParameter(key, value, "a list")
        return [conform(item, v, f"{key}[{i}]") for i, v in enumerate(value)]
    if typing.get_origin(kind) is dict:
        _, item = typing.get_args(kind)
        if not isinstance(value, dict):
            raise InvalidParameter(key, value, "a mapping of names to values")
        named = {name: conform(item, v, f"{key}.{name}") for name, v in value.items()}
        return {**default, **named} if isinstance(default, dict) else named
    return _conform_struct(kind, value, key, default)


def _choices(declared: typing.Any) -> tuple[tuple[typing.Any, ...], bool]:
    """Returns the types that a field can hold, the default first, and whether it can be None.

    A union names them; a base has those that `kinds` knows.
    """
    options = typing.get_args(declared) if _is_union(declared) else (declared,)
    kinds = [kind for option in options if option is not types.NoneType
             for kind in (kinds_of(option) or (option,))]
    return tuple(kinds), types.NoneType in options


def structs_of(declared: typing.Any) -> list[type]:
    """Returns the structs that a field, or an element of it, can hold, the default first."""
    if typing.get_args(declared) and not _is_union(declared):
        return [struct for inner in typing.get_args(declared) for struct in structs_of(inner)]
    return [struct for kind in _choices(declared)[0] for struct in (
        structs_of(kind) if typing.get_args(kind) else [kind] if _is_struct(kind) else [])]


def dump_typed(value: object, leave_out: Collection[str] = ()) -> str:
    """Returns a dataclass or config struct as YAML, of which `load_typed` makes an equal one.

    A part is tagged with the name of its type, unless that is the first one its field names. A
    field that is None is left out.

    Args:
        value: The object; its parts may be of types that no field names.
        leave_out: Names of fields that are not written.
    """
    return "".join(_entry(name, getattr(value, name), declared, leave_out)
                   for name, declared in field_types(type(value)).items()
                   if name not in leave_out and getattr(value, name) is not None)


def _entry(name: str, value: typing.Any, declared: typing.Any, leave_out: Collection[str]) -> str:
    """Returns the lines of one field."""
    first = _choices(declared)[0][0]
    if _is_struct(value):
        return _struct(f"{name}:", value, first, leave_out)
    if typing.get_origin(first) is list and any(_is_struct(item) for item in value):
        first = structs_of(first)[0]
        return f"{name}:\n" + "".join(_struct("-", each, first, leave_out) for each in value)
    if first is np.ndarray:
        value = np.asarray(value, dtype=float)
    return yaml_dump_typed({name: value}, schema=types.GenericAlias(dict, (str, first)))


def _struct(head: str, value: object, first: typing.Any, leave_out: Collection[str]) -> str:
    """Returns the lines of a part below its name, or after the dash of a list."""
    tag = "" if type(value) is first else f" !{type(value).__name__}"
    body = textwrap.indent(dump_typed(value, leave_out), "  ")
    if not body:
        return f"{head}{tag} {{}}\n"
    return f"- {body[2:]}" if head + tag == "-" else f"{head}{tag}\n{body}"


def _is_struct(value: object) -> bool:
    return dataclasses.is_dataclass(value) or hasattr(value, "__fields__")


def _is_union(schema: typing.Any) -> bool:
    return isinstance(schema, types.UnionType) or typing.get_origin(schema) is typing.Union


def field_types(schema: typing.Any) -> dict[str, typing.Any]:
    """Returns the name and type of each field of a dataclass or of a Drake config struct."""
    if dataclasses.is_dataclass(schema):
        hints = typing.get_type_hints(schema)
        return {f.name: hints[f.name] for f in dataclasses.fields(schema)}
    return {f.name: f.type for f in schema.__fields__}


def field_docs(schema: type) -> dict[str, str]:
    """Returns the docstring below each field of a struct by name, in one line; some have none."""
    found = attribute_docs(filter(dataclasses.is_dataclass, schema.__mro__))
    return {name: " ".join(found.get(name, "").split()) for name in field_types(schema)}


def _conform_choice(kinds: tuple[typing.Any, ...], value: object, key: str, default: object
                    ) -> typing.Any:
    """Returns a mapping as the kind that its tag names, or as the first one."""
    by_tag = {f"!{kind.__name__}": kind for kind in kinds}
    allowed = f"a mapping tagged {' or '.join(by_tag)}"
    if not isinstance(value, dict):
        raise InvalidParameter(key, value, allowed)
    tag = value.get("_tag", next(iter(by_tag)))
    if tag not in by_tag:
        raise InvalidParameter(key, tag, allowed + suggestion(str(tag), list(by_tag)))
    inside = {k: v for k, v in value.items() if k != "_tag"}
    return _conform_struct(by_tag[tag], inside, key, default)


def _conform_struct(schema: typing.Any, value: object, key: str, default: object) -> typing.Any:
    """Returns a mapping as a struct, with the fields of `default` that it does not name."""
    if not isinstance(value, dict):
        raise InvalidParameter(key or "the file", value, "a mapping of keys to values")
    fields = field_types(schema)
    out = deepcopy(default) if type(default) is schema else schema()
    for name, item in value.items():
        path = f"{key}.{name}" if key else str(name)
        if name == "_tag":
            only = f"!{schema.__name__}"
            require(item == only, key or "the file", item,
                    f"{only}, or left out: there is no choice")
            continue
        if name not in fields:
            raise InvalidParameter(path, item, f"under one of the keys {', '.join(fields)}"
                                   + suggestion(str(name), list(fields)))
        setattr(out, name, conform(fields[name], item, path, getattr(out, name)))
    return out


def suggestion(word: str, known: list[str]) -> str:
    """Returns the known word that is nearest to one that is not, for the end of a message."""
    close = difflib.get_close_matches(word, known, n=1)
    return f" (did you mean '{close[0]}'?)" if close else ""


def _text(value: object, key: str) -> object:
    require(isinstance(value, str), key, value,
            "text (in quotes, if it looks like something else)")
    return value


def _boolean(value: object, key: str) -> object:
    require(isinstance(value, bool), key, value, "true or false")
    return value


def _integer(value: object, key: str) -> int:
    number = _to_float(value)
    if number is None or not number.is_integer():
        raise InvalidParameter(key, value, "a whole number")
    return value if isinstance(value, int) else int(number)


def _number(value: object, key: str) -> float:
    number = _to_float(value)
    if number is None:
        raise InvalidParameter(key, value, "a finite number")
    if abs(number) > LARGEST:
        raise InvalidParameter(key, value, f"a number between ±{LARGEST:g}")
    return number


def _to_float(value: object) -> float | None:
    """Returns a finite number or None. YAML 1.1 takes 1e-3, without a dot, for text."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _array(value: object, key: str) -> np.ndarray:
    """Returns nested lists of numbers as an array."""
    return np.array(_rows(value, key), dtype=float)


def _rows(value: object, key: str) -> list[object]:
    if not isinstance(value, list):
        raise InvalidParameter(key, value, "a list of numbers")
    items: list[typing.Any] = [(_rows if isinstance(item, list) else _number)(item, f"{key}[{i}]")
                               for i, item in enumerate(value)]
    require(len({np.shape(item) for item in items}) <= 1, key, value,
            "a list of numbers, or of rows of equal length")
    return items


_LEAVES: dict[type, Callable[[object, str], object]] = {
    str: _text, bool: _boolean, int: _integer, float: _number, np.ndarray: _array}
