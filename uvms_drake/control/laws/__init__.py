"""Ancillary laws, one a file, which keep the real state in a tube about the nominal one."""

from uvms_drake.control.laws.resolved import Resolved
from uvms_drake.control.laws.tip_first import TipFirst
from uvms_drake.control.laws.transpose import Transpose

__all__ = ["AnyLaw", "Resolved", "TipFirst", "Transpose"]

AnyLaw = Resolved | Transpose | TipFirst
"""The laws that a scenario's file may name; the first is the one meant without a tag."""
