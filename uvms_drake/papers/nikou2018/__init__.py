"""The scheme of Nikou, Verginis and Dimarogonas (2018): its law, tubes, simulation and errata.

A scenario imports it by its key, `modules: [uvms_drake.papers.nikou2018]`, which registers the law
`!Transpose`, the constants that its tube needs, and its tube.
"""

from uvms_drake.certificate.text import HELP
from uvms_drake.papers.nikou2018.transpose import Transpose

__all__ = ["Transpose"]

HELP.update({
    "a": "a larger ancillary.sigma or slower speed limits",
    "b": "a larger ancillary.k",
    "ab": "a larger ancillary.k",
    "n": "ancillary.joints: true, or the law resolved",
})
