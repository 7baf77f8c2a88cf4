"""The mission of a scenario, between the contact estimate and the controller's targets."""

from typing import TYPE_CHECKING

from pydrake.geometry import Meshcat
from pydrake.systems.framework import DiagramBuilder, OutputPort

from uvms_drake.common.wiring import outputs, wire
from uvms_drake.mission.system import MissionControl
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.sensor_actuator import Signals
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.problem import task_place
from uvms_drake.visual.controls import HomeButton

if TYPE_CHECKING:
    from uvms_drake.station.scenario.scenario import Scenario

LOGGED = {"due_place": "mission_place", "due_force": "mission_force",
          "progress": "mission_progress"}
"""Signal for each output of the mission that is logged."""


def add_mission(builder: DiagramBuilder, scenario: "Scenario", model: ContactModel,
                state: OutputPort, signals: Signals, meshcat: Meshcat | None
                ) -> dict[str, OutputPort]:
    """Adds the mission, and returns the ports of its targets by the names of those inputs.

    Args:
        builder: Builder to add to.
        scenario: The scenario, with a sensed contact.
        model: The controller's model.
        state: Output port of the measured (𝔮, ζ).
        signals: Signals of the loop, with the estimate of the contact; the mission's are added.
        meshcat: Meshcat of a stop button; None: an input port `stop`.
    """
    mission = builder.AddNamedSystem("mission", MissionControl(
        scenario.mission, model, sensed_contact(scenario).walls, task_place(scenario)))
    wire(builder, mission, {**signals, "state": state})
    if meshcat is None:
        builder.ExportInput(mission.GetInputPort("stop"), "stop")
    else:
        wire(builder, mission, outputs(HomeButton.AddToBuilder(builder, meshcat)))
    asked = outputs(mission)
    for port, name in LOGGED.items():
        signals[name] = asked.pop(port)
    return asked
