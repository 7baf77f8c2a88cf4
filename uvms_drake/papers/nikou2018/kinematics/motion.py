"""Kinematic motion: the velocity is the input, w is added to the end-effector's velocity."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort

from uvms_drake.common.errors import require, vector, within
from uvms_drake.common.kinds import register
from uvms_drake.control.laws.law import AncillaryLaw, RunBound
from uvms_drake.control.ocp.ocp import MpcConfig
from uvms_drake.control.ocp.solvers import make_solver
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.uvms_model import UvmsModel
from uvms_drake.papers.nikou2018.kinematics.controller import make_kinematic_tube_mpc
from uvms_drake.papers.nikou2018.kinematics.disturbance import add_tip_disturbance
from uvms_drake.papers.nikou2018.kinematics.laws import velocity_law
from uvms_drake.papers.nikou2018.kinematics.ocp import KinematicOcp
from uvms_drake.papers.nikou2018.kinematics.plant import make_kinematic_plant
from uvms_drake.papers.nikou2018.kinematics.tube import KINEMATIC_TUBES
from uvms_drake.plant.disturbance import Disturbance
from uvms_drake.station.motions.motion import Motion
from uvms_drake.station.problem import posed_task
from uvms_drake.station.signals import POSE, SPEEDS, TWIST, Components
from uvms_drake.tube.constants import Constant, estimate_constants
from uvms_drake.tube.estimates import CertificateSettings
from uvms_drake.tube.search.constraint_set import ConstraintSet

if TYPE_CHECKING:
    from uvms_drake.station.scenario.scenario import Scenario

VELOCITY: Components = (*TWIST, SPEEDS)
"""Components of the input."""
TIP_VELOCITY: Components = tuple((part, f"{unit}/s") for part, unit in POSE)
"""Components of w."""


@register
@dataclass
class Kinematic(Motion[KinematicOcp]):
    """The robot moves at the commanded velocity, without water and forces."""

    name = "kinematic"
    has_forces = False
    measured, command, effect = "configuration", "u", "zeta"
    tubes = KINEMATIC_TUBES
    disturbance_symbol, disturbance_unit = "w", "m/s, rad/s"
    disturbance_blocks = ("position", "orientation")
    stages = (0.01, 0.96, 0.98)
    components: ClassVar[dict[str, Components]] = {
        "u": VELOCITY, "nominal_input": VELOCITY, "disturbance": TIP_VELOCITY,
        "effective_disturbance": TIP_VELOCITY}
    adversaries = ("along_task_error", "constant", "sinusoid")

    def check(self, scenario: "Scenario") -> None:
        """Raises `InvalidParameter` for the first value that has no meaning with this motion."""
        require(not np.any(vector("current", scenario.current, 3)), "current", scenario.current,
                "zero, without water (motion: kinematic)")
        require(not scenario.waves, "waves", scenario.waves,
                "left out, without water (motion: kinematic)")
        require(scenario.model_error.size == 0.0, "model_error", scenario.model_error,
                "left out where the velocity is the input (motion: kinematic)")
        require(scenario.surface_error.size == 0.0, "surface_error", scenario.surface_error,
                "left out, without contact (motion: kinematic)")
        weights = scenario.disturbance.weights
        require(np.size(weights) == 0, "disturbance.weights", weights,
                "left out where the velocity is the input (motion: kinematic)")

    def disturbance_size(self, size: int) -> int:
        """Returns the number of components of w."""
        return 6

    def make_ocp(self, scenario: "Scenario", model: ContactModel) -> KinematicOcp:
        """Returns the nominal MPC's problem; see `motions.make_ocp`."""
        y_des, limits = posed_task(scenario, model, accelerations=False)
        with within("mpc"):
            return KinematicOcp(model, scenario.mpc, y_des, limits)

    def make_plant(self, scenario: "Scenario", start: np.ndarray) -> Diagram:
        """Returns the simulated robot, from 𝔮 = `start` (6+n,)."""
        return make_kinematic_plant(
            scenario.model, disturbance=None, seed=scenario.seed, start=start,
            task_frame=np.asarray(scenario.task.frame, dtype=float))

    def make_controller(self, scenario: "Scenario", model: ContactModel, ocp: KinematicOcp
                        ) -> Diagram:
        """Returns the tube-based NMPC."""
        with within("mpc"):
            solver = make_solver(ocp)
        with within("ancillary"):
            return make_kinematic_tube_mpc(ocp, scenario.ancillary, solver)

    def add_disturbance(self, builder: DiagramBuilder, disturbance: Disturbance, model: UvmsModel,
                        seed: int, signals: Mapping[str, OutputPort]) -> OutputPort:
        """Adds the source of w; see `Motion`."""
        return add_tip_disturbance(builder, disturbance, seed, signals)

    def run_bound(self, law: AncillaryLaw, d_bound: float) -> RunBound:
        """Returns the bound along a run of χ̇ = J(𝔮)ζ + w, ‖w‖₂ ≤ w̃."""
        return velocity_law(law).run_bound(law, d_bound)

    def figures(self) -> dict[str, Callable[..., Any]]:
        """Returns the three result figures of the paper."""
        from uvms_drake.papers.nikou2018.kinematics.figures import FIGURES

        return FIGURES

    def completed(self, scenario: "Scenario", model: ContactModel, logs: dict[str, np.ndarray]
                  ) -> dict[str, np.ndarray]:
        """Returns the logs with the force that the surface's law gives for the pose at rest."""
        chi = model.task_pose(logs["state"][:, : model.size])[:, :6]
        nothing = np.empty((len(chi), 0))
        return logs | {
            "force": model.surface.force(chi, np.zeros_like(chi)),
            "penetration": model.surface.penetration(chi), "tau": nothing,
            "acceleration": nothing, "input_limited": np.zeros(len(chi)),
            "desired_force": np.tile(np.asarray(scenario.task.force), (len(chi), 1)),
            "effective_disturbance": logs["disturbance"]}

    def assumed_settings(self, mpc: MpcConfig) -> list[tuple[str, str, float]]:
        """Returns key, reason and size of this motion's assumptions about the MPC; 0 if kept."""
        free = int(np.count_nonzero(np.asarray(mpc.weight_y)[6:] == 0.0))
        return [("joints of weight zero", "which no terminal set covers", free)]

    def constants(self, names: tuple[str, ...], model: ContactModel, declared: ConstraintSet,
                  weights: np.ndarray, settings: CertificateSettings) -> dict[str, Constant]:
        """Returns constants by name, all estimated."""
        return estimate_constants(
            model, declared, names, samples=settings.constant_samples,
            safety_factor=settings.safety_factor, seed=settings.seed)
