"""`help` prints the attributes of the classes that a script uses, with their units."""

import dataclasses
import pydoc

import pytest

import uvms_drake as uv


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
