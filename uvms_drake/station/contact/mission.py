"""The mission of a scenario, between the contact estimate and the controller's targets."""

from typing import TYPE_CHECKING

from pydrake.geometry import Meshcat
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from uvms_drake.mission.system import MissionControl
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.sensor_actuator import Signals
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.problem import task_place
from uvms_drake.visual.controls import HomeButton

if TYPE_CHECKING:
    from uvms_drake.station.scenario.scenario import Scenario

LOGGED = {"mission_place": "due_place", "mission_force": "due_force",
          "mission_progress": "progress"}
"""Output of the mission for each signal."""


def add_mission(builder: DiagramBuilder, scenario: "Scenario", model: ContactModel,
                controller: Diagram, state: OutputPort, signals: Signals,
                meshcat: Meshcat | None) -> None:
    """Adds the mission, or exports the ports of its targets if there is none.

    Args:
        builder: Builder to add to.
        scenario: The scenario, with a sensed contact.
        model: The controller's model.
        controller: Controller of `make_tube_mpc` with a `PressControl`.
        state: Output port of the measured (𝔮, ζ).
        signals: Signals of the loop, to which the mission's are added.
        meshcat: Meshcat of a stop button; None: an input port `stop`.
    """
    asked = ("place", "deepest")
    if not scenario.mission.steps:
        for name in asked:
            builder.ExportInput(controller.GetInputPort(name), name)
        return
    mission = MissionControl.AddToBuilder(
        builder, scenario.mission, model, sensed_contact(scenario).walls, task_place(scenario),
        state=state, force_last_valid=signals["force_last_valid"], touched=signals["touched"],
        force_lost=signals["force_lost"])
    for name in (*asked, "desired_force"):
        builder.Connect(mission.GetOutputPort(name), controller.GetInputPort(name))
    stop = mission.GetInputPort("stop")
    if meshcat is None:
        builder.ExportInput(stop, "stop")
    else:
        builder.Connect(HomeButton.AddToBuilder(builder, meshcat).get_output_port(), stop)
    for name, port in LOGGED.items():
        signals[name] = mission.GetOutputPort(port)
