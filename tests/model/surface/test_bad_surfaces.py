"""Surfaces, laws and contacts without a meaning: the first bad value is named."""

from dataclasses import replace

import numpy as np
import pytest

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.model.surface.contact_laws import Bilinear, Hardening, Linear
from uvms_drake.model.surface.geometry import Bead, Bumpy, Cylinder, Plane
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.surface.shaped_surface import ShapedSurface
from uvms_drake.model.surface.spring import BilateralSpring
from uvms_drake.model.surface.unknown_contact import HoldForces, UnknownContact

CONTACT = UnknownContact()


@pytest.mark.parametrize(("bad", "message"), [
    (UnilateralPlane(normal=np.array([1.0, 1.0, 0.0])), "normal = .*: must be a unit vector"),
    (UnilateralPlane(stiffness=0.0), "stiffness = 0.0: must be positive"),
    (UnilateralPlane(dissipation=-1.0), "dissipation = -1.0: must be zero or positive"),
    (UnilateralPlane(dissipation=1e4), "dissipation = 10000.0: must be at most 1000 s/m"),
    (BilateralSpring(stiffness=-np.eye(6)), "stiffness = .*: must be"),
    (ShapedSurface(Plane(point=np.zeros(2))), "geometry.point = .*: must be 3 finite numbers"),
    (ShapedSurface(Cylinder(axis=np.array([0.6, 0.0, 0.8]))), "axis = .*: must be perpendicular"),
    (ShapedSurface(Cylinder(radius=0.0)), "geometry.radius = 0.0: must be positive"),
    (ShapedSurface(Bumpy(wavelength=np.inf)), "geometry.wavelength = inf: must be from 0.001"),
    (ShapedSurface(Bumpy(amplitude=0.2, wavelength=0.1)), "geometry.slope = .*: must be at most 1"),
    (ShapedSurface(Bead(width=-1.0)), "geometry.width = -1.0: must be positive"),
    (ShapedSurface(law=Linear(transition=-1.0)), "law.transition = -1.0: must be positive"),
    (ShapedSurface(law=Bilinear(knee=0.001)), "law.knee = 0.001: must be at least the transition"),
    (ShapedSurface(law=Hardening(ratio=0.5)), "law.ratio = 0.5: must be at least 1"),
    (ShapedSurface(friction=3.0), "friction = 3.0: must be from 0 to 2"),
    (ShapedSurface(creep=0.0), "creep = 0.0: must be positive"),
    (replace(CONTACT, angle=0.5), "angle = 0.5: must be from 0 to 0.45"),
    (replace(CONTACT, tool_angle=0.0), "tool_angle = 0.0: must be positive"),
    (replace(CONTACT, force=0.0), "force = 0.0: must be positive"),
    (replace(CONTACT, hold=HoldForces(force_rate=100.0)), "hold.force_rate = 100.0: must be")])
def test_the_first_bad_value_is_named(bad, message):
    with pytest.raises(InvalidParameter, match=message):
        bad.checked()
