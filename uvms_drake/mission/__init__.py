"""Inspection missions as lists of steps: references by time and contact state; no controller."""

from uvms_drake.mission.law import RUNNING
from uvms_drake.mission.steps import Approach, Hold, Mission, Pressing, Retreat, Slide, Step
from uvms_drake.mission.system import MissionControl

__all__ = ["RUNNING", "Approach", "Hold", "Mission", "MissionControl", "Pressing", "Retreat",
           "Slide", "Step"]
