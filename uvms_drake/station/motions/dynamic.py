"""Dynamic motion: forces move the robot, d is added to its acceleration."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from uvms_drake.control.ocp.dynamic_ocp import DynamicOcp
from uvms_drake.control.ocp.ocp import MpcConfig
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.plant.adversary import KINDS
from uvms_drake.plant.disturbance import Disturbance, OpenLoopDisturbance
from uvms_drake.plant.uvms_plant import make_uvms_plant
from uvms_drake.station.motions.motion import Motion
from uvms_drake.station.problem import true_surface
from uvms_drake.tube.constants import Constant, estimate_constants
from uvms_drake.tube.covering import prove_constants
from uvms_drake.tube.estimates import CertificateSettings
from uvms_drake.tube.law_tube import PROVEN, WEIGHTED
from uvms_drake.tube.laws import DYNAMIC_TUBES
from uvms_drake.tube.search.constraint_set import ConstraintSet

if TYPE_CHECKING:
    from uvms_drake.station.scenario.scenario import Scenario


@dataclass
class Dynamic(Motion[DynamicOcp]):
    """Forces move the robot under water, in front of a surface."""

    name = "dynamic"
    has_forces = True
    measured, command, effect = "state", "tau", "tau"
    tubes = DYNAMIC_TUBES
    disturbance_symbol, disturbance_unit = "d", "m/s², rad/s²"
    disturbance_blocks = ("surge, sway, heave", "roll, pitch, yaw", "joints")
    stages = (0.04, 0.7, 0.99)
    adversaries = KINDS

    def check(self, scenario: "Scenario") -> None:
        """Raises `InvalidParameter` for the first value that has no meaning with this motion."""

    def disturbance_size(self, size: int) -> int:
        """Returns the number of components of d."""
        return size

    def make_ocp(self, scenario: "Scenario", model: ContactModel) -> DynamicOcp:
        """Returns the nominal MPC's problem; see `motions.make_ocp`."""
        return scenario.contact.make_ocp(scenario, model)

    def make_plant(self, scenario: "Scenario", start: np.ndarray) -> Diagram:
        """Returns the simulated robot, from 𝔮 = `start` (6+n,)."""
        return make_simulated_uvms(scenario, None, start)

    def make_controller(self, scenario: "Scenario", model: ContactModel, ocp: DynamicOcp
                        ) -> Diagram:
        """Returns the tube-based NMPC of the scenario's kind of contact."""
        return scenario.contact.make_controller(scenario, model, ocp)

    def add_disturbance(self, builder: DiagramBuilder, disturbance: Disturbance, model: UvmsModel,
                        seed: int, signals: Mapping[str, OutputPort]) -> OutputPort:
        """Adds the source of d; see `Motion`."""
        return disturbance.add_to(builder, model, seed, signals)

    def completed(self, scenario: "Scenario", model: ContactModel, logs: dict[str, np.ndarray]
                  ) -> dict[str, np.ndarray]:
        """Returns the logs with the effective disturbance."""
        return logs | {"effective_disturbance": effective_disturbance(
            model, logs["state"], sent_input(model, logs), logs["acceleration"],
            scenario.contact.force_in_law(logs))}

    def assumed_settings(self, mpc: MpcConfig) -> list[tuple[str, str, float]]:
        """Returns key, reason and size of this motion's assumptions about the MPC; 0 if kept."""
        return [("mpc.input_reference", "not the equilibrium's input",
                 mpc.input_reference != "equilibrium")]

    def constants(self, names: tuple[str, ...], model: ContactModel, declared: ConstraintSet,
                  weights: np.ndarray, settings: CertificateSettings) -> dict[str, Constant]:
        """Returns constants by name; those that decide the tube of `resolved` are proven."""
        ball = bool(np.all(weights == 1.0))
        norms = {name if ball else WEIGHTED[name]: name for name in PROVEN.values()}
        proven = prove_constants(
            model, declared, tuple(norms[name] for name in names if name in norms),
            seed=settings.seed, weights=weights)
        estimated = estimate_constants(
            model, declared, tuple(name for name in names if name not in norms),
            samples=settings.constant_samples, safety_factor=settings.safety_factor,
            seed=settings.seed)
        return estimated | {name: replace(proven[plain], name=name)
                            for name, plain in norms.items() if plain in proven}


def make_simulated_uvms(scenario: "Scenario", disturbance: OpenLoopDisturbance | None,
                        start: np.ndarray | None = None) -> Diagram:
    """Returns the robot and the surface as they are, which the controller may not know.

    Args:
        scenario: "Scenario" of dynamic motion; its own disturbance is ignored.
        disturbance: As of `make_uvms_plant`.
        start: Likewise.
    """
    return make_uvms_plant(
        scenario.model, surface=true_surface(scenario),
        disturbance=disturbance, seed=scenario.seed, start=start,
        error=scenario.model_error,
        task_frame=np.asarray(scenario.task.frame, dtype=float))


def effective_disturbance(model: ContactModel, state: np.ndarray, u: np.ndarray,
                          acceleration: np.ndarray, contact: np.ndarray | None = None
                          ) -> np.ndarray:
    """Returns ζ̇ − f(𝔮, ζ) − 𝔲 (T, 6+n) [m/s², rad/s²]: all that the controller does not model.

    The disturbance, errors of the model, another surface, a current, a stuck joint: every deviation
    from ζ̇ = f + 𝔲, in the units of d̃. It is d where there is nothing
    else. 𝔲 is the sent command, after limits and the hold of a clock, which d̃ does not cover; see
    `sent_input`.

    Args:
        model: The controller's.
        state: (𝔮, ζ) (T, 2(6+n)).
        u: 𝔲, the command (T, 6+n).
        acceleration: ζ̇ of the robot (T, 6+n).
        contact: The force that the law takes in place of the surface's, if it does (T, 6).
    """
    config, zeta = np.split(state, 2, axis=1)
    return acceleration - model.drift(config, zeta, contact) - u


def sent_input(model: ContactModel, logs: dict[str, np.ndarray]) -> np.ndarray:
    """Returns 𝔲 as it is sent (T, 6+n): M⁻¹τ of a clock's hold, the law's if there is none."""
    if "zoh_command" not in logs:
        return logs["u"]
    M = model.mass_matrix(model.kinematics(logs["state"][:, : model.size]))
    sent: np.ndarray = np.linalg.solve(M, logs["zoh_command"][..., None])[..., 0]
    return sent
