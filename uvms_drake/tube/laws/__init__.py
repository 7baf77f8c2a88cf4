"""Tubes of the ancillary laws, one a file, and the names for a tube of one's own."""

from uvms_drake.control.limits import TubeRadii
from uvms_drake.tube.conditions import Condition, assumption
from uvms_drake.tube.constants import Quantity, register_constant
from uvms_drake.tube.law_tube import TUBES, Basis, LawTube, register_tube
from uvms_drake.tube.laws.resolved import resolved_law_tube
from uvms_drake.tube.laws.tip_first import tip_first_law_tube

__all__ = ["TUBES", "Basis", "Condition", "LawTube", "Quantity", "TubeRadii", "assumption",
           "register_constant", "register_tube", "resolved_law_tube", "tip_first_law_tube"]
