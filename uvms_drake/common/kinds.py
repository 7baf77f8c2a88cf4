"""Kinds that a file names by a tag: those of the package, and those that a script registers.

A base, such as `Surface`, has kinds, such as `UnilateralPlane`. A field of a scenario has a base as
its type; a file chooses the kind by its tag, `surface: !UnilateralPlane {stiffness: 2000}`.
"""

import dataclasses
import typing
from typing import TypeVar

from uvms_drake.common.errors import require

T = TypeVar("T")

_KINDS: dict[type, dict[str, type]] = {}
"""By base, its kinds by name, the default first."""


def offer(base: type, *kinds: type) -> None:
    """Declares the kinds of a base that come with the package.

    Args:
        base: Type of a field of a scenario, or of the elements of a list.
        kinds: Its dataclasses; the first is that of a mapping without a tag.
    """
    _KINDS[base] = {kind.__name__: kind for kind in kinds}
    for kind in kinds:
        _show_plain_types(kind)


def kinds_of(base: object) -> tuple[type, ...]:
    """Returns the kinds of a base, the default first; empty if it is none."""
    return tuple(_KINDS[base].values()) if isinstance(base, type) and base in _KINDS else ()


def register(kind: type[T]) -> type[T]:
    """Registers a kind of one's own, so that a scenario's file can name it by a tag; a decorator.

    ::

        @uv.register
        @dataclass
        class SoftWall(uv.Surface):
            stiffness: float = 500.0  # N/m

    Its base is the first of its bases in the order of inheritance that has kinds. A file names the
    module in its key `modules`, unless a script has registered the kind before it loads the file.

    Raises:
        InvalidParameter: It is no dataclass with a default for every field, it derives from none of
            the bases, or its name is taken.
    """
    name = kind.__name__
    require("__dataclass_fields__" in vars(kind), "register", name,
            "a dataclass: @uv.register comes above @dataclass")
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]  # It is a dataclass.
        required = field.init and field.default is dataclasses.MISSING and (
            field.default_factory is dataclasses.MISSING)
        require(not required, f"{name}.{field.name}", "required", "given a default, for files")
    bases = [base for base in kind.__mro__ if base in _KINDS]
    require(bool(bases), "register", name,
            f"derived from one of {', '.join(sorted(base.__name__ for base in _KINDS))}")
    known = _KINDS[bases[0]]
    before = known.get(name)
    # The cell of a notebook, or a module that is imported again, replaces its former kind.
    again = before is not None and (before.__module__, before.__qualname__) == (
        kind.__module__, kind.__qualname__)
    require(before is None or again, "register", name,
            "another name: a kind of this name is there already")
    known[name] = kind
    _show_plain_types(kind)
    return kind


def _show_plain_types(struct: typing.Any) -> None:
    """Leaves the constraints out of the types that a dataclass tells of its fields, and below it.

    Drake's `yaml_load_typed` reads these and knows no `Annotated`; `schema` reads the annotations.
    """
    hints = typing.get_type_hints(struct)
    for field in dataclasses.fields(struct):
        field.type = hints[field.name]
        if dataclasses.is_dataclass(field.type):
            _show_plain_types(field.type)
