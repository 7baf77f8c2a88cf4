"""The scheme of Nikou, Verginis and Dimarogonas (2018): its law, tubes, simulation and errata.

A scenario imports it by its key, `modules: [uvms_drake.papers.nikou2018]`, which registers the law
`!Transpose`, the constants that its tubes need, its tubes, and `motion: kinematic`.
"""

from uvms_drake.certificate.text import HELP, UNITS
from uvms_drake.papers.nikou2018 import transpose_tube  # noqa: F401  it registers
from uvms_drake.papers.nikou2018.kinematics.motion import Kinematic
from uvms_drake.papers.nikou2018.transpose import Transpose

__all__ = ["Kinematic", "Transpose"]

HELP.update({
    "a": "a larger ancillary.sigma or slower speed limits",
    "b": "a larger ancillary.k",
    "ab": "a larger ancillary.k",
    "joints of weight zero": "positive joint weights in mpc.weight_y",
    "n": "ancillary.joints: true, or the law resolved",
})
UNITS.update(dict.fromkeys(("smallest k", "at σ", "smallest σ"), "1/s"))
UNITS.update(dict.fromkeys((
    "printed radius", "corrected radius", "comparison system radius", "radius of resolved"),
    "m, rad"))
