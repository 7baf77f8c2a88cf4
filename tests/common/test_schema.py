"""Tests of `uvms_drake.common.schema`."""

import math
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
import pytest
from pydrake.common.yaml import yaml_load_typed

import uvms_drake as uv
from uvms_drake.common.constraints import NotNegative, OneOf, Positive, Vector
from uvms_drake.common.errors import ScenarioError, require
from uvms_drake.common.kinds import offer
from uvms_drake.common.schema import check_values, conform, dump_typed, load_typed, parse_yaml


@dataclass
class Round:
    radius: float = 1.0


@dataclass
class Square:
    sides: np.ndarray = field(default_factory=lambda: np.ones(2))


@dataclass
class Part:
    shape: Round | Square = field(default_factory=Round)
    count: int = 0
    label: str = ""
    hollow: bool = False
    offset: np.ndarray | None = None
    holes: list[Round] = field(default_factory=list)
    named: dict[str, Round] = field(default_factory=dict)


def message(text: str) -> str:
    with pytest.raises(uv.InvalidParameter) as caught:
        conform(Part, parse_yaml(text))
    return str(caught.value)


def test_every_kind_of_field_is_loaded_with_its_type():
    part = load_typed(Part, parse_yaml(
        "{shape: !Square {sides: [1, 2e-3]}, count: 3, label: a, hollow: true, offset: [[1, 2]],"
        " holes: [{radius: 1e-3}], named: {big: {radius: 5}}}"))
    np.testing.assert_array_equal(part.shape.sides, [1.0, 2e-3])
    np.testing.assert_array_equal(part.offset, [[1.0, 2.0]])
    assert (part.count, part.label, part.hollow) == (3, "a", True)
    assert (part.holes[0].radius, part.named["big"].radius) == (1e-3, 5.0)


def test_numbers_that_yaml_takes_for_text_become_floats():
    assert conform(Part, parse_yaml("shape: {radius: 1e-3}")).shape.radius == 1e-3
    assert math.isclose(conform(np.ndarray, ["1e-3", 2])[0], 1e-3)


@dataclass
class Star(Round):
    points: int = 5


def test_what_is_dumped_loads_as_it_was():
    part = Part(shape=Square(np.array([1e-5, 2.0])), count=3, label="a: 'b'\n c", hollow=True,
                offset=np.eye(2), holes=[Round(1e-3), Round()])
    again = load_typed(Part, parse_yaml(dump_typed(part)))
    np.testing.assert_array_equal(again.shape.sides, part.shape.sides)
    np.testing.assert_array_equal(again.offset, part.offset)
    assert (again.count, again.label, again.hollow, again.holes) == (
        part.count, part.label, part.hollow, part.holes)


def test_a_type_that_no_field_names_is_dumped_under_its_name():
    """Also one derived from a type that it names; Drake's own dump takes that for its base."""
    data = parse_yaml(dump_typed(Part(shape=Star(2.0), holes=[Star(points=3), Round()])))
    assert data["shape"] == {"_tag": "!Star", "radius": 2.0, "points": 5}
    assert data["holes"] == [{"_tag": "!Star", "radius": 1.0, "points": 3}, {"radius": 1.0}]


@pytest.mark.parametrize(("text", "expected"), [
    ("cuont: 1", "cuont = 1: must be under one of the keys shape, count, label, hollow, offset, "
                 "holes, named (did you mean 'count'?)"),
    ("holes: [{}, {radus: 1}]",
     "holes[1].radus = 1: must be under one of the keys radius (did you mean 'radius'?)"),
    ("count: 1.5", "count = 1.5: must be a whole number"),
    ("label: 5", "label = 5: must be text (in quotes, if it looks like something else)"),
    ("hollow: 1", "hollow = 1: must be true or false"),
    ("shape: {radius: wide}", "shape.radius = 'wide': must be a finite number"),
    ("shape: {radius: inf}", "shape.radius = 'inf': must be a finite number"),
    ("shape: !Sqare {}", "shape = '!Sqare': must be a mapping tagged !Round or !Square "
                         "(did you mean '!Square'?)"),
    ("offset: [1, x]", "offset[1] = 'x': must be a finite number"),
    ("offset: [[1, 2], [3]]",
     "offset = [[1, 2], [3]]: must be a list of numbers, or of rows of equal length"),
    ("named: []", "named = []: must be a mapping of names to values"),
    ("holes: [!Square {}]",
     "holes[0] = '!Square': must be !Round, or left out: there is no choice"),
    ("[1]", "the file = [1]: must be a mapping of keys to values"),
])
def test_a_mistake_is_named_by_key_value_and_what_is_allowed(text, expected):
    assert message(text) == expected


@pytest.mark.parametrize(("text", "expected"), [
    ("a: [1, 2\nb: 3", "line 2, column 2: expected ',' or ']', but got ':'"),
    ("a: 1\nb: {c: 2, c: 3}", "line 2: the key 'c' is there already, in line 2"),
    ("a: !Tag", "line 1, column 4: expected a mapping node, but found scalar"),
])
def test_a_yaml_syntax_error_is_one_line_with_its_place(text, expected):
    with pytest.raises(ScenarioError) as caught:
        parse_yaml(text)
    assert str(caught.value) == expected


def test_an_alias_a_merged_mapping_and_a_mapping_within_itself_have_no_key_twice():
    assert parse_yaml("a: &a {c: 1}\nb: {<<: *a, c: 2}\nd: [*a, *a]") == {
        "a": {"c": 1}, "b": {"c": 2}, "d": [{"c": 1}, {"c": 1}]}
    loop = parse_yaml("a: &a {b: *a}")
    assert loop["a"]["b"] is loop["a"]


@dataclass
class Spring:
    stiffness: Annotated[float, Positive] = 1.0
    rows: Annotated[np.ndarray, Vector(2), NotNegative] = field(default_factory=lambda: np.ones(2))
    law: Annotated[str, OneOf("linear", "cubic")] = "linear"
    limit: Annotated[float, Positive] | None = None

    def check(self):
        require(self.stiffness < 10.0 * self.rows[0], "stiffness", self.stiffness, "softer")


@dataclass
class Springs:
    each: list[Spring] = field(default_factory=list)


@pytest.mark.parametrize(("raw", "text"), [
    ({"stiffness": 0}, "each[0].stiffness = 0.0: must be positive"),
    ({"rows": [1]}, "each[0].rows = [1.]: must be 2 finite numbers"),
    ({"rows": [1, -1]}, "each[0].rows = [ 1., -1.]: must be zero or positive"),
    ({"law": "square"}, "each[0].law = 'square': must be one of linear, cubic"),
    ({"limit": -1}, "each[0].limit = -1.0: must be positive"),
    ({"stiffness": 11}, "each[0].stiffness = 11.0: must be softer"),
])
def test_the_constraints_of_a_schema_are_checked_at_load_and_in_python(raw, text):
    with pytest.raises(uv.InvalidParameter) as caught:
        load_typed(Springs, {"each": [raw]})
    assert str(caught.value) == text
    values = {key: np.array(value, dtype=float) if isinstance(value, list) else value
              for key, value in raw.items()}
    with pytest.raises(uv.InvalidParameter, match=text.split(" = ")[0].replace("[0]", r"\[0\]")):
        check_values(Springs([Spring(**values)]))


def test_drakes_own_loader_reads_a_schema_with_constraints():
    offer(Springs, Spring)
    assert yaml_load_typed(schema=Spring, data="{stiffness: 2, limit: 3}").limit == 3.0
    with pytest.raises(uv.InvalidParameter):
        load_typed(Spring, {"limit": -3.0})
