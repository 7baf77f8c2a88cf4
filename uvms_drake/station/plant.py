"""The simulated robot of any scenario, with its water and its disturbance, in one Diagram."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder

from uvms_drake.common.errors import require, vector, within
from uvms_drake.common.schema import check_values
from uvms_drake.common.wiring import outputs, wire
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.signals.fault import Fault
from uvms_drake.plant.disturbance import Disturbance, OpenLoopDisturbance
from uvms_drake.plant.uvms_plant import make_uvms_plant
from uvms_drake.plant.waves import WaterMotion
from uvms_drake.station.problem import load_model, true_surface
from uvms_drake.station.scenario.parts import faults_at
from uvms_drake.station.scenario.scenario import Scenario


def make_plant(scenario: Scenario, model: ContactModel | None = None) -> Diagram:
    """Returns the simulated robot of a scenario, as a Diagram "plant", for `make_controller`.

    ::

        tau ──────────────────────────▶┌──────┐──▶ state, force, penetration, chi, ...
        water ──▶ current ────────────▶│ uvms │
        disturbance ──────────────────▶└──────┘

    It is that of `make_station`: with model error, current, waves and the true surface, which the
    controller does not know, at rest at `scenario.start`.

    .. pydrake_system::

        name: plant
        input_ports:
        - tau
        output_ports:
        - state
        - force
        - disturbance, ... (all others of make_uvms_plant)

    - `tau`: τ (6+n) [N, N m], as of `make_uvms_plant`.
    - `state`: (𝔮, ζ) (2(6+n)) [m, rad, m/s, rad/s].
    - `force`: 𝔉 (6) on the surface [N, N m].

    Args:
        scenario: Robot, start, surface, water, model error and disturbance; with a step of the
            integrator, which `uv.with_step` chooses for that of a file.
        model: The controller's model; loaded if left out.

    Raises:
        InvalidParameter: A value of the scenario cannot be used; also a disturbance that is aimed
            by the tube's errors, which only a station has.
    """
    model = model or load_model(scenario)
    check_values(scenario)
    # A Simulator with a largest step of zero would never end.
    step = scenario.simulator.max_step_size
    require(step > 0.0, "simulator.max_step_size", step,
            "positive in a Diagram of one's own: uv.with_step(scenario) chooses it")
    builder = DiagramBuilder()
    with within("start"):
        start = np.concatenate([vector("eta", scenario.start.eta, 6),
                                vector("q", scenario.start.q, model.num_joints)])
    uvms = builder.AddNamedSystem("uvms", make_simulated_uvms(scenario, None, start))
    water = builder.AddNamedSystem("water", WaterMotion(scenario.current, [
        *scenario.waves, *faults_at("water", scenario.faults).values()]))
    wire(builder, uvms, outputs(water))
    disturbance = applied_disturbance(
        scenario.disturbance, scenario.model_error.share, scenario.faults)
    require(isinstance(disturbance, OpenLoopDisturbance), "disturbance", type(disturbance).__name__,
            "a function of time alone, or in a station, which has the errors that aim it")
    with within("disturbance"):
        source = disturbance.add_to(builder, model, scenario.seed, {})
    builder.Connect(source, uvms.GetInputPort("disturbance"))
    builder.ExportInput(uvms.GetInputPort("tau"), "tau")
    for i in range(uvms.num_output_ports()):
        port = uvms.get_output_port(i)
        builder.ExportOutput(port, port.get_name())
    diagram = builder.Build()
    diagram.set_name("plant")
    return diagram


def make_simulated_uvms(scenario: Scenario, disturbance: OpenLoopDisturbance | None,
                        start: np.ndarray | None = None) -> Diagram:
    """Returns the robot and the surface as they are, which the controller may not know.

    Args:
        scenario: Scenario; its own disturbance is ignored.
        disturbance: As of `make_uvms_plant`.
        start: Likewise.
    """
    return make_uvms_plant(
        scenario.model, surface=true_surface(scenario),
        disturbance=disturbance, seed=scenario.seed, start=start,
        error=scenario.model_error,
        task_frame=np.asarray(scenario.task.frame, dtype=float))


def applied_disturbance(declared: Disturbance, share: float, faults: Sequence[Fault]
                        ) -> Disturbance:
    """Returns the declared disturbance, less the share of d̃ of model errors, in excess by faults.

    Args:
        declared: Disturbance of the scenario.
        share: As of `ModelError`.
        faults: Faults of the scenario.
    """
    excess = math.prod(fault.factor for fault in faults_at("disturbance", faults).values())
    return replace(declared, bound=excess * (1.0 - share) * declared.bound)
