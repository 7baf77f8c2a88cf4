"""Robust interaction control of underwater vehicle-manipulator systems, on Drake."""

__version__ = "0.1.0"
