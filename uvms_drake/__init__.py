"""Robust interaction control of underwater vehicle-manipulator systems, on Drake.

::

                 ┌────────────┐ (ξ̄, ū)  ┌───────────────────┐ τ
        task ───▶│ NominalMpc ├────────▶│ AncillaryFeedback ├──▶ actuation ──▶ ┌──────┐
                 └──────▲─────┘         └─────────▲─────────┘                  │ uvms │──▶ force
                        └────────────┬────────────┘                            └──┬───┘
                                     └──────────────── sensing ◀──────────────────┘ (𝔮, ζ)

Names for scripts are here, by `import uvms_drake as uv`; one is loaded when it is first used. Kinds
are in namespaces: `uv.laws`, `uv.limits`, `uv.costs`, `uv.surfaces`, `uv.sensors`, `uv.actuators`,
`uv.disturbances`; the steps of a mission in `uv.mission`, and tubes of laws in `uv.tubes`.
"""

import re
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from uvms_drake.common.attribute_docs import describe_attributes
from uvms_drake.common.program import VERSION

if TYPE_CHECKING:
    from uvms_drake import actuation as actuators  # noqa: F401  a namespace
    from uvms_drake import mission as mission
    from uvms_drake import sensing as sensors  # noqa: F401  a namespace
    from uvms_drake.actuation import Actuator as Actuator
    from uvms_drake.certificate.certificate import Certificate as Certificate
    from uvms_drake.certificate.certify import certify as certify
    from uvms_drake.common.errors import InvalidParameter as InvalidParameter
    from uvms_drake.common.errors import RunFailed as RunFailed
    from uvms_drake.common.kinds import register as register
    from uvms_drake.control import costs as costs
    from uvms_drake.control import laws as laws
    from uvms_drake.control import limits as limits
    from uvms_drake.control.costs.costs import CostTerm as CostTerm
    from uvms_drake.control.laws.law import AncillaryLaw as AncillaryLaw
    from uvms_drake.control.laws.law import Command as Command
    from uvms_drake.control.laws.law import Pair as Pair
    from uvms_drake.control.laws.resolved import Resolved as Resolved
    from uvms_drake.control.limits.limit import Limit as Limit
    from uvms_drake.control.ocp.ocp_program import OcpProgram as OcpProgram
    from uvms_drake.control.ocp.solvers import make_solver as make_solver
    from uvms_drake.control.plan.points import Points as Points
    from uvms_drake.control.tube_mpc import make_tube_mpc as make_tube_mpc
    from uvms_drake.identification.identify import identify as identify
    from uvms_drake.loop.controller import Controller as Controller
    from uvms_drake.model import surface as surfaces  # noqa: F401  a namespace
    from uvms_drake.model.contact_model import ContactModel as ContactModel
    from uvms_drake.model.frames.euler import pose_difference as pose_difference
    from uvms_drake.model.propulsion.thrusters import ThrusterModel as ThrusterModel
    from uvms_drake.model.robot import Robot as Robot
    from uvms_drake.model.signals.command_path import CommandPath as CommandPath
    from uvms_drake.model.signals.sensor_actuator import Part as Part
    from uvms_drake.model.signals.sensor_actuator import Signals as Signals
    from uvms_drake.model.surface.law import Surface as Surface
    from uvms_drake.model.surface.plane import UnilateralPlane as UnilateralPlane
    from uvms_drake.model.surface.shaped_surface import ShapedSurface as ShapedSurface
    from uvms_drake.model.surface.spring import BilateralSpring as BilateralSpring
    from uvms_drake.model.uvms_model import UvmsModel as UvmsModel
    from uvms_drake.model.uvms_model import configuration_rate as configuration_rate
    from uvms_drake.model.uvms_model import read_uvms as read_uvms
    from uvms_drake.plant import disturbance as disturbances  # noqa: F401  a namespace
    from uvms_drake.plant.disturbance import DirectedDisturbance as DirectedDisturbance
    from uvms_drake.plant.disturbance import Disturbance as Disturbance
    from uvms_drake.plant.disturbance import OpenLoopDisturbance as OpenLoopDisturbance
    from uvms_drake.plant.disturbance import SinusoidalDisturbance as SinusoidalDisturbance
    from uvms_drake.plant.uvms_plant import make_uvms_plant as make_uvms_plant
    from uvms_drake.plant.uvms_plant import set_state as set_state
    from uvms_drake.report.figures import make_figures as make_figures
    from uvms_drake.report.summary import summarise as summarise
    from uvms_drake.sensing import Sensor as Sensor
    from uvms_drake.setup.calibrate import calibrate as calibrate
    from uvms_drake.setup.make_scenario import make_scenario as make_scenario
    from uvms_drake.station.controller import make_controller as make_controller
    from uvms_drake.station.diagram import make_station as make_station
    from uvms_drake.station.diagram import read_logs as read_logs
    from uvms_drake.station.plant import make_plant as make_plant
    from uvms_drake.station.problem import load_model as load_model
    from uvms_drake.station.problem import make_ocp as make_ocp
    from uvms_drake.station.problem import start_state as start_state
    from uvms_drake.station.record import Record as Record
    from uvms_drake.station.record import load_record as load_record
    from uvms_drake.station.scenario.contact import Contact as Contact
    from uvms_drake.station.scenario.contact import SensedContact as SensedContact
    from uvms_drake.station.scenario.scenario import Scenario as Scenario
    from uvms_drake.station.scenario.scenario import load_scenario as load_scenario
    from uvms_drake.station.simulation import simulate as simulate
    from uvms_drake.station.step_size import with_step as with_step
    from uvms_drake.tube import laws as tubes  # noqa: F401  a namespace
    from uvms_drake.visual.stage import open_meshcat as open_meshcat

__version__ = VERSION

_OFFERED = {alias: (module, name) for module, name, alias in re.findall(
    r"^    from (\S+) import (\w+) as (\w+)", Path(__file__).read_text(encoding="utf-8"), re.M)}
"""Module and name there of each name that is offered: the imports above, made at first use."""

__all__ = sorted(_OFFERED, key=str.lower)


def __getattr__(name: str) -> Any:
    """Returns a name of `__all__`, from the module that owns it, with `help` on its attributes."""
    if name not in _OFFERED:
        raise AttributeError(f"module 'uvms_drake' has no attribute {name!r}")
    module, own = _OFFERED[name]
    value = vars(import_module(module)).get(own) or import_module(f"{module}.{own}")
    for each in list(vars(value).values()) if isinstance(value, ModuleType) else [value]:
        if isinstance(each, type):
            describe_attributes(each)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Returns the names that the package offers."""
    return sorted([*__all__, *(name for name in globals() if name.startswith("__"))])
