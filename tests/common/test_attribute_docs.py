"""`help` prints the attributes of the classes that a script uses, with their units."""

import dataclasses
import pydoc
from typing import NamedTuple

import pytest

import uvms_drake as uv
from uvms_drake.common.attribute_docs import describe_attributes


@pytest.mark.parametrize("kind", [
    uv.Record, uv.UnilateralPlane, uv.Resolved, uv.limits.Limits, uv.sensors.ForceSensor])
def test_help_on_a_dataclass_says_it_of_each_field(kind):
    text = pydoc.plain(pydoc.render_doc(kind)).split("Attributes:")[1]
    fields = [each.name for each in dataclasses.fields(kind) if each.name != "scenario"]
    assert [name for name in fields if f"    {name}: " not in text] == []


def test_a_kind_inherits_the_descriptions_that_it_does_not_replace():
    text = uv.surfaces.Hardening.__doc__
    assert "transition: Depth w over which" in text
    assert text.count("\n    stiffness: ") == 1


def test_a_class_from_elsewhere_stays_as_it_is():
    class Elsewhere(NamedTuple):
        """Nothing of ours."""

        size: int
        """Size."""

    describe_attributes(Elsewhere)
    assert Elsewhere.__doc__ == "Nothing of ours."
