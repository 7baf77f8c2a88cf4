"""Ancillary laws, one a file, which keep the real state in a tube about the nominal one."""

from uvms_drake.common.kinds import offer
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.control.laws.resolved import Resolved
from uvms_drake.control.laws.tip_first import TipFirst

__all__ = ["AncillaryLaw", "Resolved", "TipFirst"]

offer(AncillaryLaw, Resolved, TipFirst)
