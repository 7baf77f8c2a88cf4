"""A scenario: everything a run depends on, in one YAML file.

The parameters of each part are declared with that part; here they are composed and checked.
`scenario_file` has the files, their bases, and overrides.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
from pydrake.common.yaml import yaml_load_data
from pydrake.systems.analysis import GetIntegrationSchemes, SimulatorConfig

from uvms_drake.actuation import IdealWrench, Thrusters
from uvms_drake.common.constraints import AtMost, NotNegative, OneOf, Positive, Vector
from uvms_drake.common.errors import require, shortened, vector
from uvms_drake.common.schema import check_values, conform, dump_typed, parse_yaml, read_text
from uvms_drake.control.laws import AncillaryLaw, Resolved
from uvms_drake.control.limits import Limits, TubeRadii
from uvms_drake.control.ocp.ocp import MpcConfig
from uvms_drake.mission.steps import Mission
from uvms_drake.model.signals.fault import Fault
from uvms_drake.model.signals.sensor_actuator import Actuator, Sensor
from uvms_drake.model.surface import Surface, UnilateralPlane
from uvms_drake.model.surface.law import check_surface
from uvms_drake.plant import Disturbance, SinusoidalDisturbance
from uvms_drake.plant.model_error import ModelError, Unknowns
from uvms_drake.plant.surface import SurfaceError
from uvms_drake.plant.waves import Wave
from uvms_drake.station.scenario import scenario_file
from uvms_drake.station.scenario.contact import Contact, KnownSurface
from uvms_drake.station.scenario.identified import Identified
from uvms_drake.station.scenario.modules import import_modules
from uvms_drake.station.scenario.parts import keyed
from uvms_drake.tube.estimates import CertificateSettings
from uvms_drake.visual.stage import VisualConfig

LARGEST_SEED = 2**63 - 1
LONGEST_NAME = 100
"""Largest length of a scenario's name [bytes in UTF-8]; file systems allow 255, with a suffix."""

SAMPLE_BYTES = 4e3
"""Memory of a sample of all logged signals [B]."""
PLAN_BYTES = 2.5e3
"""Memory of a plan's program, over the square of its horizon [B]."""
STEP_SECONDS = 1e-3
"""Time of a step of the integrator [s]."""
INTERVAL_SECONDS = 1e-3
"""Time of making a plan, over its horizon [s]."""
MOST_BYTES = 4e9
"""Memory that a run may take [B]."""
MOST_HOURS = 8.0
"""Time that a run may take [h]."""


@dataclass
class Start:
    """State at t = 0, at rest."""

    eta: Annotated[np.ndarray, Vector(6)] = field(default_factory=lambda: np.zeros(6))
    """Vehicle's pose η = (x, y, z, φ, θ, ψ) in Σ_I [m, rad]."""
    q: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Joint angles [rad]."""

    @property
    def config(self) -> np.ndarray:
        """𝔮 = (η, q) (6+n,) [m, rad]."""
        return np.concatenate([self.eta, self.q])


@dataclass
class Task:
    """The task of the end-effector."""

    force: Annotated[np.ndarray, Vector(6)] = field(default_factory=lambda: np.zeros(6))
    """Desired wrench 𝔉_des on the surface, in Σ_I (6,) [N, N m]."""
    pose: Annotated[np.ndarray, Vector(6)] | None = None
    """Pose χ on the surface for the coordinates free of 𝔉_des; none for a spring."""
    frame: Annotated[np.ndarray, Vector(3)] = field(default_factory=lambda: np.zeros(3))
    """ZYX Euler angles in Σ_I of the task's frame Σ_T, about whose axes the end-effector's Euler
    angles are, those of `pose` too (3,) [rad]. Zero is the paper's, in which a tool that points up
    or down is singular; with −π/2 for the second, x of Σ_T points down, into a floor."""
    posture: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """Joint angles q_des [rad], which resolve the redundancy of vehicle and arm."""
    force_tolerance: Annotated[float, Positive] = 2.0
    """Size of 𝔉 − 𝔉_des below which the force counts as settled [N, N m]."""

    def check(self) -> None:
        """Raises `InvalidParameter` for a force that would count as settled from the start."""
        force = float(np.linalg.norm(self.force))
        require(force == 0.0 or self.force_tolerance < force, "force_tolerance",
                self.force_tolerance, f"smaller than the desired force itself, {force:g} N")

    @property
    def place(self) -> np.ndarray:
        """Position of its pose in Σ_I (3,) [m]."""
        return vector("task.pose", self.pose, 6)[:3]

    def force_along(self, direction: np.ndarray) -> float:
        """Returns the desired force along a direction (3,) [N]."""
        return float(np.asarray(self.force)[:3] @ direction)


@dataclass
class Draws:
    """Distribution of starts, forces and times of drawn runs.

    A force or speed that is left out follows from limits less the tube; a certificate in
    probability needs both, so that its distribution does not depend on the radii.
    """

    joints: Annotated[np.ndarray, NotNegative] = field(default_factory=lambda: np.zeros(0))
    """Largest distance of each joint from `start.q` (n,) [rad, m]; empty: up to its limits."""
    force: Annotated[np.ndarray, Vector(2), Positive] | None = None
    """Smallest and largest desired force [N]; None: 5 to 30 N, up to the largest that the safe
    region admits. That of a mission's steps is theirs."""
    speed: Annotated[float, Positive] | None = None
    """Speed of an approach that the time of a run counts with [m/s]; None: the fastest plan's."""
    hold: Annotated[np.ndarray, Vector(2), NotNegative] = field(
        default_factory=lambda: np.array([5.0, 20.0]))
    """Smallest and largest time of a hold after the expected settling of the force [s]."""

    def check(self) -> None:
        """Raises `InvalidParameter` for a range without a value."""
        for key in ("force", "hold"):
            value = getattr(self, key)
            require(value is None or value[0] <= value[1], key, value, "the smaller number first")


@dataclass
class Supervision:
    """Supervisor: its thresholds follow from the declared data, the retreat is this."""

    distance: Annotated[float, Positive] = 0.3
    """Distance by which the vehicle goes back [m]."""
    speed: Annotated[float, Positive] = 0.1
    """Speed of the vehicle at that [m/s]."""
    draw: Annotated[float, NotNegative] = 0.04
    """Distance by which the arm draws the tip back after a touch [m]."""
    draw_speed: Annotated[float, Positive] = 0.15
    """Largest speed of the tip at that [m/s]."""
    drift: Annotated[np.ndarray, Vector(2), Positive] | None = None
    """Threshold of the disturbance of the vehicle, linear and angular (2,) [m/s², rad/s²]; None:
    that by the declared unknowns. A drawn run has that of the scenario it is drawn from."""
    reading: Annotated[np.ndarray, Vector(3), NotNegative] | None = None
    """Error of a reading: in all, the part that may change, that which does not (3,) [N]; None: by
    the declared data. Of a drawn run likewise."""


@dataclass
class Scenario:
    """A run of the closed loop.

    Of a choice of types (surface, disturbance, ancillary) the first is that of a mapping without a
    tag.
    """

    name: str = ""
    """Name of the scenario; that of the file if left out."""
    description: str = ""
    modules: list[str] = field(default_factory=list)
    """Python modules, imported first, that register kinds of their own, see `common.kinds`: names,
    or paths of files from the scenario's file. Their code runs, as that of any import."""
    seed: Annotated[int, NotNegative, AtMost(LARGEST_SEED)] = 0
    """Seed of everything random."""
    duration: Annotated[float, Positive] = 20.0
    """Simulated time [s]. A sensor drifts until its end, and a certificate counts with that."""
    simulation: str = ""
    """Module that runs and certifies the scenario in place of the station, by a simulation of its
    own, as that of a paper, `papers.nikou2018.kinematic_run`."""
    model: str = "girona500_arm5e"
    """Name of a shipped robot, or a robot's folder, from the scenario's file or from where the
    program runs."""
    start: Start = field(default_factory=Start)
    current: Annotated[np.ndarray, Vector(3)] = field(default_factory=lambda: np.zeros(3))
    """Velocity of the water in Σ_I [m/s]; the controller does not know it."""
    waves: list[Wave] = field(default_factory=list)
    """Waves on top of it, which the controller does not know either."""
    model_error: ModelError = field(default_factory=ModelError)
    """Difference of the simulated robot from the controller's model."""
    identified: Identified | None = None
    """Logs that the robot and `model_error` were identified from, which a verdict names."""
    surface: Surface = field(default_factory=UnilateralPlane)
    surface_error: SurfaceError = field(default_factory=SurfaceError)
    """Difference of the simulated surface from `surface`, the controller's model."""
    contact: Contact = field(default_factory=KnownSurface)
    """Kind of contact: the controller knows `surface`, or senses an unknown wall."""
    disturbance: Disturbance = field(default_factory=SinusoidalDisturbance)
    draws: Draws = field(default_factory=Draws)
    """Distribution of the runs of a campaign or of a certificate in probability."""
    sensing: list[Sensor] = field(default_factory=list)
    """Parts between the robot's state and the controller, from the robot on."""
    actuation: list[Actuator] = field(default_factory=list)
    """Parts between the controller's command and the robot, from the controller on."""
    faults: list[Fault] = field(default_factory=list)
    """Faults, at most one of a kind; an entry without a tag is a `SolverFailure`."""
    task: Task = field(default_factory=Task)
    mission: Mission = field(default_factory=Mission)
    """Sequence of pressing steps on an unknown surface; without steps `task` holds at all times."""
    limits: Limits = field(default_factory=Limits)
    tube: TubeRadii = field(default_factory=TubeRadii)
    mpc: MpcConfig = field(default_factory=MpcConfig)
    ancillary: AncillaryLaw = field(default_factory=Resolved)
    certificate: CertificateSettings = field(default_factory=CertificateSettings)
    simulator: SimulatorConfig = field(default_factory=lambda: SimulatorConfig(
        integration_scheme="runge_kutta3", max_step_size=0.0, use_error_control=False))
    """Integrator; a step of zero is chosen by the rates of the loop, see `step_size.with_step`."""
    log_period: Annotated[float, Positive] = 0.02
    """Time between two samples of every logged signal [s]."""
    supervisor: Supervision | None = field(default_factory=Supervision)
    """Supervisor of a sensed contact, with which the robot retreats when a run leaves its class;
    null for none. A known surface has no class, and none."""
    visual: VisualConfig = field(default_factory=VisualConfig)

    def check(self) -> None:
        """Raises `InvalidParameter` for the first value that has no meaning with the others."""
        angles = np.asarray(self.start.eta, dtype=float)[3:]
        require(bool(np.all(np.abs(angles) <= 2.0 * np.pi)), "start.eta", self.start.eta,
                "with angles within ±2π")
        require(self.log_period <= self.duration, "log_period", self.log_period,
                f"at most the duration, {self.duration:g} s")
        require(not self.mission.steps or self.contact.declared_wall() is not None,
                "mission.steps", self.mission.steps, "left out, without a sensed contact")
        # Parts and faults, and the integrator.
        allocated = any(type(part) is Thrusters for part in self.actuation)
        for key, part in keyed("actuation", self.actuation[:None if allocated else -1]).items():
            require(not isinstance(part, IdealWrench), key, "IdealWrench",
                    "the last part, and left out beside !Thrusters")
        for i, fault in enumerate(self.faults):
            require(type(fault) not in map(type, self.faults[:i]), f"faults[{i}]",
                    type(fault).__name__, "of a kind that is not declared twice")
        _check_simulator(self.simulator)
        self.check_cost(self.simulator.max_step_size)

    def check_cost(self, max_step_size: float) -> None:
        """Raises `InvalidParameter` for the first size that makes a run too large.

        Args:
            max_step_size: Largest step of the integrator [s].
        """
        horizon = float(self.mpc.horizon)
        plan = PLAN_BYTES * horizon**2
        require(plan <= MOST_BYTES, "mpc.horizon", self.mpc.horizon,
                f"at most {(MOST_BYTES / PLAN_BYTES) ** 0.5:.0f}: one plan would take "
                f"{plan / 1e9:.2g} GB of memory")
        memory, hours = "GB of memory", "hours"
        for key, period, cost, most, unit in (
                ("log_period", self.log_period, SAMPLE_BYTES / 1e9, MOST_BYTES / 1e9, memory),
                ("simulator.max_step_size", max_step_size, STEP_SECONDS / 3600.0, MOST_HOURS,
                 hours),
                ("mpc.time_step", self.mpc.time_step, INTERVAL_SECONDS / 3600.0 * horizon,
                 MOST_HOURS, hours)):
            if period > 0.0:  # Other values are refused elsewhere.
                total = self.duration / period * cost
                require(total <= most, key, period,
                        f"at least {self.duration * cost / most:.2g} s, or the duration shorter: "
                        f"{self.duration:g} s would take about {total:.2g} {unit}")

    @property
    def law(self) -> str:
        """Name of the ancillary law, such as `resolved`."""
        return self.ancillary.name

    @property
    def unknowns(self) -> Unknowns:
        """Declared unknowns: model error, current and waves."""
        return Unknowns(self.model_error, np.asarray(self.current, dtype=float), self.waves)


def load_scenario(name_or_path: str, overrides: Sequence[str] = (),
                  options: Sequence[str] | None = None) -> Scenario:
    """Returns a scenario from a file, with the defaults and the overrides put in.

    Args:
        name_or_path: Name of a shipped scenario or path of a YAML file.
        overrides: Texts `key.path=value` with a YAML value; an element of a list is a key too,
            `limits.u.0=0.2`. They come last and change the resolved scenario, so a key below a
            tagged mapping keeps its tag.
        options: Words of the command line for messages about them; by default, `--set`s.

    Raises:
        ScenarioError: A value is not allowed; one line with file, key, value and allowed values.
    """
    path = scenario_file.scenario_path(name_or_path)
    with scenario_file.reported_in(path.name):
        scenario = scenario_of(read_text(path), path)
        scenario.name = scenario.name or path.stem
    options = scenario_file.set_options(overrides) if options is None else options
    with scenario_file.reported_in(scenario_file.scenario_source(name_or_path, options)):
        if overrides:
            scenario = typed_scenario(
                scenario_file.apply_overrides(yaml_load_data(dump_scenario(scenario)), overrides))
        check_values(scenario)
        name = scenario.name
        usable = name.isprintable() and not any(c in name for c in "/\\") and (
            0 < len(name.encode(errors="replace")) <= LONGEST_NAME and name not in (".", ".."))
        require(usable, "name", shortened(name),
                f"usable as the name of a folder, of at most {LONGEST_NAME} bytes")
    return scenario


def scenario_of(text: str, path: Path) -> Scenario:
    """Returns the scenario of the text of a file, not checked."""
    return typed_scenario(scenario_file.with_base(parse_yaml(text), path, ()))


def typed_scenario(raw: object) -> Scenario:
    """Returns raw data as a scenario, not checked, after the import of the modules it names."""
    if isinstance(raw, dict) and "modules" in raw:
        raw = {**raw, "modules": import_modules(conform(list[str], raw["modules"], "modules"))}
    scenario_file.refuse_gone(raw)
    scenario: Scenario = conform(Scenario, raw)
    return scenario


def dump_scenario(scenario: Scenario) -> str:
    """Returns the fully resolved scenario as YAML; loading it gives the same scenario."""
    # A setting of Drake 1.51 that 1.58 lacks, without effect on a run.
    text = dump_typed(scenario, leave_out=("publish_every_time_step",))
    # Drake leaves out None, which is not the default here.
    return text if scenario.supervisor is not None else f"{text}supervisor: null\n"


def _check_simulator(settings: SimulatorConfig) -> None:
    """Raises `InvalidParameter` for a value of Drake's settings that a run cannot use."""
    for key, constraint in (
            ("integration_scheme", OneOf(*GetIntegrationSchemes())), ("accuracy", Positive),
            ("max_step_size", NotNegative), ("target_realtime_rate", NotNegative)):
        constraint.check(f"simulator.{key}", getattr(settings, key))
    require(settings.start_time == 0.0, "simulator.start_time", settings.start_time, "0")


def remarks(scenario: Scenario) -> list[str]:
    """Returns a line for every accepted value without effect."""
    lines = [f"faults[{i}].start = {start:g} s is after the end of the run: it never happens"
             for i, fault in enumerate(scenario.faults)
             if (start := getattr(fault, "start", 0.0)) >= scenario.duration]
    task, step = scenario.task, scenario.simulator.max_step_size
    if task.pose is not None:
        surface = scenario.contact.controller_surface(check_surface(scenario.surface))
        pose, force = np.asarray(task.pose, dtype=float), np.asarray(task.force, dtype=float)
        off = surface.pose_for(force, pose)[:3] - pose[:3]
        depth = surface.penetration_for(float(np.linalg.norm(force[:3]))) or 0.0
        if np.linalg.norm(off) > 2.0 * depth:
            lines.append(f"task.pose is {np.linalg.norm(off):.3g} m off the surface: along its "
                         "normal, the desired force determines the position")
    if scenario.mpc.hover >= scenario.duration:
        lines.append(f"mpc.hover = {scenario.mpc.hover:g} s is not before the end of the run: the "
                     "robot only hovers, and no tube is monitored without a certificate")
    forces = [part.reading(0.0, 0.0) is not None for part in scenario.sensing]
    if True in forces and not all(forces[(first := forces.index(True)):]):
        lines.append(f"sensing[{first}] measures the force in the true attitude: parts that "
                     "change the measured one come after it")
    shortest = min(scenario.log_period, scenario.mpc.time_step)
    if step > shortest:
        lines.append(f"simulator.max_step_size = {step:g} s is cut to {shortest:g} s by the log or "
                     "the MPC")
    return lines
