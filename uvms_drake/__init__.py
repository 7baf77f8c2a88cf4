"""Robust interaction control of underwater vehicle-manipulator systems, on Drake.

::

                 ┌────────────┐ (ξ̄, ū)  ┌───────────────────┐ τ
        task ───▶│ NominalMpc ├────────▶│ AncillaryFeedback ├──▶ actuation ──▶ ┌──────┐
                 └──────▲─────┘         └─────────▲─────────┘                  │ uvms │──▶ force
                        └────────────┬────────────┘                            └──┬───┘
                                     └──────────────── sensing ◀──────────────────┘ (𝔮, ζ)

Names for scripts are here, by `import uvms_drake as uv`; one is loaded when it is first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from uvms_drake.common.program import VERSION

if TYPE_CHECKING:
    from uvms_drake.actuation import Actuator as Actuator
    from uvms_drake.certificate.certificate import Certificate as Certificate
    from uvms_drake.certificate.certify import certify as certify
    from uvms_drake.common.kinds import register as register
    from uvms_drake.control.costs.term import CostTerm as CostTerm
    from uvms_drake.control.laws.law import AncillaryLaw as AncillaryLaw
    from uvms_drake.control.laws.law import Command as Command
    from uvms_drake.control.laws.law import Pair as Pair
    from uvms_drake.control.laws.resolved import Resolved as Resolved
    from uvms_drake.control.limits.limit import Limit as Limit
    from uvms_drake.control.plan.points import Points as Points
    from uvms_drake.control.tube_mpc import make_tube_mpc as make_tube_mpc
    from uvms_drake.model.contact_model import ContactModel as ContactModel
    from uvms_drake.model.frames.euler import pose_difference as pose_difference
    from uvms_drake.model.robot import Robot as Robot
    from uvms_drake.model.signals.sensor_actuator import Part as Part
    from uvms_drake.model.signals.sensor_actuator import Signals as Signals
    from uvms_drake.model.surface.law import Surface as Surface
    from uvms_drake.model.surface.plane import UnilateralPlane as UnilateralPlane
    from uvms_drake.model.surface.shaped_surface import ShapedSurface as ShapedSurface
    from uvms_drake.model.surface.spring import BilateralSpring as BilateralSpring
    from uvms_drake.model.uvms_model import UvmsModel as UvmsModel
    from uvms_drake.model.uvms_model import read_uvms as read_uvms
    from uvms_drake.plant.disturbance import Disturbance as Disturbance
    from uvms_drake.plant.disturbance import SinusoidalDisturbance as SinusoidalDisturbance
    from uvms_drake.plant.uvms_plant import make_uvms_plant as make_uvms_plant
    from uvms_drake.plant.uvms_plant import set_state as set_state
    from uvms_drake.report.figures import make_figures as make_figures
    from uvms_drake.report.summary import summarise as summarise
    from uvms_drake.sensing import Sensor as Sensor
    from uvms_drake.station.controller import make_controller as make_controller
    from uvms_drake.station.diagram import make_station as make_station
    from uvms_drake.station.diagram import read_logs as read_logs
    from uvms_drake.station.motions.motions import make_ocp as make_ocp
    from uvms_drake.station.problem import start_state as start_state
    from uvms_drake.station.record import Record as Record
    from uvms_drake.station.record import load_record as load_record
    from uvms_drake.station.scenario.scenario import Scenario as Scenario
    from uvms_drake.station.scenario.scenario import load_scenario as load_scenario
    from uvms_drake.station.simulation import simulate as simulate
    from uvms_drake.station.step_size import with_step as with_step

__version__ = VERSION

_HOME = {
    "Actuator": "actuation",
    "AncillaryLaw": "control.laws.law",
    "BilateralSpring": "model.surface.spring",
    "Certificate": "certificate.certificate",
    "certify": "certificate.certify",
    "Command": "control.laws.law",
    "ContactModel": "model.contact_model",
    "CostTerm": "control.costs.term",
    "Disturbance": "plant.disturbance",
    "Limit": "control.limits.limit",
    "load_record": "station.record",
    "load_scenario": "station.scenario.scenario",
    "make_controller": "station.controller",
    "make_figures": "report.figures",
    "make_ocp": "station.motions.motions",
    "make_station": "station.diagram",
    "make_tube_mpc": "control.tube_mpc",
    "make_uvms_plant": "plant.uvms_plant",
    "Pair": "control.laws.law",
    "Part": "model.signals.sensor_actuator",
    "Points": "control.plan.points",
    "pose_difference": "model.frames.euler",
    "read_logs": "station.diagram",
    "read_uvms": "model.uvms_model",
    "Record": "station.record",
    "register": "common.kinds",
    "Resolved": "control.laws.resolved",
    "Robot": "model.robot",
    "Scenario": "station.scenario.scenario",
    "Sensor": "sensing",
    "set_state": "plant.uvms_plant",
    "ShapedSurface": "model.surface.shaped_surface",
    "Signals": "model.signals.sensor_actuator",
    "simulate": "station.simulation",
    "SinusoidalDisturbance": "plant.disturbance",
    "start_state": "station.problem",
    "summarise": "report.summary",
    "Surface": "model.surface.law",
    "UnilateralPlane": "model.surface.plane",
    "UvmsModel": "model.uvms_model",
    "with_step": "station.step_size",
}
"""Module of each name below this package."""

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    """Returns a name of `__all__`, from the module that owns it."""
    if name not in _HOME:
        raise AttributeError(f"module 'uvms_drake' has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"uvms_drake.{_HOME[name]}"), name)
    return value


def __dir__() -> list[str]:
    """Returns the names that the package offers."""
    return sorted([*globals(), *_HOME])
