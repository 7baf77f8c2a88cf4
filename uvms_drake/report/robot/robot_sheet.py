"""A robot in numbers: the data sheet that `uvms-drake robot` prints."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from uvms_drake.control.laws.outputs import best_rows, row_names
from uvms_drake.model.description.hydrodynamics_file import added_mass_about_origin
from uvms_drake.model.description.thruster_file import AXES
from uvms_drake.model.description.water_center import center_of_water
from uvms_drake.model.propulsion.allocation import Allocation, largest_wrench
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.trim import Trim, trim_of
from uvms_drake.model.uvms import STANDARD_GRAVITY, Uvms, slides
from uvms_drake.model.uvms_model import UvmsModel

POSTURES = 2000
"""Random postures within the joints' limits that reach and dexterity are found from."""
NEAR = (0.2, 0.05, 0.01)
"""Sizes of the steps by which the ends of the reach are sought on [rad, m]."""
TURNING, SLIDING = ("rad", "kg m²", "N m s/rad"), ("m", "kg", "N s/m")
"""Units of a joint's limits, inertia and damping."""
STEEP = np.deg2rad(80.0)
"""Pitch of the tip that no task can be near to."""
STIFF = 0.5
"""Height of the centre of buoyancy above that of mass that no vehicle has [m]."""
NO_FORCE = 1e-9
"""Limit of a thruster that pushes one way only, the other way [N]."""


@dataclass(frozen=True)
class Swing:
    """Free oscillation of the vehicle about one axis, the arm fixed and all else free."""

    stiffness: float
    """∂moment/∂angle by weight and buoyancy [N m/rad]."""
    period: float
    """2π √(I/k) [s], I the inertia with the water; infinite if nothing rights it."""
    damping: float
    """Damping ratio by linear drag; quadratic drag vanishes at rest."""


@dataclass(frozen=True)
class Thrust:
    """Largest wrenches of the thrusters, at full voltage."""

    count: int
    largest: np.ndarray
    """(6, 2): largest wrench along and against each axis, the other driven ones zero [N, N m]."""
    undriven: tuple[str, ...]
    hover: float
    """Largest share of its limit that a thruster would have to give at rest."""
    hover_thruster: str


@dataclass(frozen=True)
class RobotSheet:
    """A robot in numbers, some of which depend on the posture of its arm."""

    name: str
    posture: np.ndarray
    trim: Trim
    inertia: np.ndarray
    """Diagonal (6+n,) of M, the water with it [kg, kg m²]."""
    roll: Swing
    pitch: Swing
    hangs: np.ndarray
    """Roll and pitch (2,) at which the robot comes to rest [rad], by its centres alone."""
    bodies: list[tuple[str, float, float, np.ndarray]]
    """Name, mass, mass of displaced water [kg], added mass in surge, sway and heave (3,) [kg]."""
    water: dict[str, tuple[str, bool]]
    """By body, the place of its added mass as a line, and whether that fits to its buoyancy."""
    joints: list[tuple[str, float, float, float, float]]
    """Name, limits, inertia of the motor at the joint, damping."""
    units: list[tuple[str, str, str]]
    """Units of a joint's limits, inertia and damping."""
    reach: np.ndarray
    """(2, 3): smallest and largest position of the tip in the vehicle's frame [m]."""
    tip: np.ndarray
    """χ (6,) of the tip for a level vehicle at the origin [m, rad]."""
    rows: tuple[str, ...]
    """The tip's coordinates that the joints alone can hold best, see `tip_rows`."""
    dexterity: np.ndarray
    """Smallest and median σ_min(J_sq) of them over the limits, and that of the posture (3,)."""
    thrust: Thrust | None


def sheet_of(uvms: Uvms, name: str, posture: np.ndarray) -> RobotSheet:
    """Returns the sheet of a robot in a finalized plant, at the joints' q (n,) [rad, m]."""
    model = UvmsModel(uvms)
    config = np.concatenate([np.zeros(6), posture])
    at, rest = model.kinematics(config), np.zeros(model.size)
    M, trim = model.mass_matrix(at), trim_of(uvms, posture)
    rng = np.random.default_rng(0)
    many = np.zeros((POSTURES, model.size))
    many[:, 6:] = rng.uniform(*model.joint_range(), (POSTURES, model.num_joints))
    rows = best_rows(model)
    lever = trim.center_of_mass - trim.center_of_buoyancy
    roll, pitch = (swing(model, config, axis) for axis in (3, 4))
    return RobotSheet(
        name=name, posture=posture, trim=trim, inertia=np.diag(M), roll=roll, pitch=pitch,
        hangs=np.array([np.arctan2(lever[1], lever[2]),
                        np.arctan2(-lever[0], np.hypot(lever[1], lever[2]))]), bodies=_bodies(uvms),
        water={name: center_of_water(
            added_mass_about_origin(body.added_mass), body.displaced_volume,
            np.asarray(body.center_of_buoyancy), uvms.hydrodynamics.fluid_density)
               for name, body in uvms.hydrodynamics.bodies.items()},
        joints=list(zip([joint.name() for joint in uvms.joints], model.q_lower, model.q_upper,
                        model.links.rotor_inertia, model.links.joint_damping, strict=True)),
        units=[SLIDING if slides(joint) else TURNING for joint in uvms.joints],
        reach=_reach(model, many, rng),
        tip=at.chi, rows=tuple(row_names(model.num_joints)[i] for i in rows),
        dexterity=_dexterity(model, many, posture),
        thrust=None if uvms.thrusters is None else thrust_of(
            ThrusterModel.of(uvms.thrusters), model.inverse_dynamics(at, rest, rest)[:6]))


def swing(model: UvmsModel, config: np.ndarray, axis: int) -> Swing:
    """Returns how the vehicle swings about an axis (3 or 4 of ζ) at rest at 𝔮 (6+n,)."""
    at, rest = model.kinematics(config), np.zeros(model.size)
    rates = model.inverse_dynamics_derivatives(at, rest, rest)
    stiffness, drag = rates[axis, axis], rates[axis, model.size + axis]
    mobility = float(np.linalg.inv(model.mass_matrix(at)[:6, :6])[axis, axis])
    if stiffness <= 0.0:
        return Swing(float(stiffness), np.inf, np.inf)
    rate = np.sqrt(stiffness * mobility)
    return Swing(float(stiffness), float(2.0 * np.pi / rate), float(0.5 * drag * mobility / rate))


def thrust_of(thrusters: ThrusterModel, wrench: np.ndarray) -> Thrust:
    """Returns the largest wrenches of the thrusters.

    Args:
        thrusters: At the voltage of the robot's file.
        wrench: Wrench that holds the vehicle (6,) [N, N m].
    """
    largest = np.array([[largest_wrench(thrusters, axis, sign) for sign in (1.0, -1.0)]
                        for axis in range(6)])
    allocation = Allocation.to(thrusters)
    forces = allocation.matrix @ wrench + allocation.bias
    limits = np.where(forces > 0.0, thrusters.upper, -thrusters.lower)
    share = np.abs(forces) / np.maximum(limits, NO_FORCE)
    return Thrust(thrusters.size, largest, tuple(AXES[i] for i in thrusters.undriven),
                  float(np.max(share)), thrusters.names[int(np.argmax(share))])


def _reach(model: UvmsModel, many: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Returns the smallest and largest position of the tip (2, 3): the best of many, and near it.

    Args:
        model: Of the robot.
        many: 𝔮 (m, 6+n) with postures within the joints' limits.
        rng: Source of the postures near it.
    """
    tips = model.task_pose(many)[:, :3]
    reach = np.array([tips.min(axis=0), tips.max(axis=0)])
    if model.num_joints == 0:
        return reach
    for end, sign in enumerate((-1.0, 1.0)):
        for axis in range(3):
            best = many[np.argmax(sign * tips[:, axis])]
            for size in NEAR:
                near = np.tile(best, (POSTURES // 20, 1))
                near[1:, 6:] = np.clip(
                    best[6:] + rng.normal(0.0, size, near[1:, 6:].shape), *model.joint_range())
                best = near[np.argmax(sign * model.task_pose(near)[:, axis])]
            reach[end, axis] = model.task_pose(best)[axis]
    return reach


def _dexterity(model: UvmsModel, many: np.ndarray, posture: np.ndarray) -> np.ndarray:
    if model.num_joints < 3:  # Then the rows are the joints themselves.
        return np.ones(3)
    smallest = dexterities(model, np.concatenate([many[:, 6:], posture[None]]))
    return np.array([smallest[:-1].min(), np.median(smallest[:-1]), smallest[-1]])


def dexterities(model: UvmsModel, postures: np.ndarray) -> np.ndarray:
    """Returns σ_min(J_sq) (m,) at q (m, n), for few joints that of the tip's position."""
    rows = best_rows(model) if model.num_joints > 2 else np.arange(3)
    config = np.concatenate([np.zeros((len(postures), 6)), postures], axis=1)
    return np.linalg.svd(
        model.task_jacobian(config)[:, rows, 6:], compute_uv=False)[:, -1]


def _bodies(uvms: Uvms) -> list[tuple[str, float, float, np.ndarray]]:
    found = []
    for index in uvms.plant.GetBodyIndices(uvms.model_instance):
        body = uvms.plant.get_body(index)
        water = uvms.water(body)
        found.append((body.name(), body.default_mass(),
                      uvms.hydrodynamics.fluid_density * water.displaced_volume,
                      np.diag(added_mass_about_origin(water.added_mass))[:3]))
    return found



def format_sheet(sheet: RobotSheet, notes: Sequence[str] = ()) -> str:
    """Returns the sheet as text.

    Args:
        sheet: The robot in numbers.
        notes: Further ones, of the robot's files.
    """
    parts = [_vehicle_lines(sheet), _arm_lines(sheet), _body_lines(sheet)]
    if sheet.thrust is not None:
        parts.append(_thrust_lines(sheet.thrust))
    parts.append([f"note: {note}" for note in (*notes_of(sheet), *notes)])
    return "\n\n".join("\n".join(lines) for lines in parts if lines)


def _vehicle_lines(sheet: RobotSheet) -> list[str]:
    trim, inertia = sheet.trim, sheet.inertia
    net = STANDARD_GRAVITY * (trim.displaced_mass - trim.mass)
    thrusters = "no thrusters.yaml" if sheet.thrust is None else (
        f"{sheet.thrust.count} thrusters")
    roll, pitch = np.degrees(sheet.hangs)
    water, _ = sheet.water.get("vehicle", ("it is dry", True))
    return [
        f"{sheet.name}: {len(sheet.joints)} joints, {thrusters}",
        f"mass        {trim.mass:.4g} kg; with the water (surge, sway, heave) "
        f"{_row(inertia[:3])} kg, (roll, pitch, yaw) {_row(inertia[3:6])} kg m²",
        f"trim        {'floats up' if net > 0.0 else 'sinks'} with {abs(net):.3g} N; let go, it "
        f"lies at roll {roll:.2g}°, pitch {pitch:.2g}°",
        f"centres     mass {_row(trim.center_of_mass)} m, buoyancy {_row(trim.center_of_buoyancy)} "
        f"m: {1e3 * trim.righting_lever:.3g} mm above",
        f"water       of the vehicle, in its axes (FRD): {water}",
        f"roll        {_swing(sheet.roll)}", f"pitch       {_swing(sheet.pitch)}"]


def _arm_lines(sheet: RobotSheet) -> list[str]:
    lines = [f"tip         {_row(sheet.tip[:3])} m, (roll, pitch, yaw) "
             f"{_row(np.degrees(sheet.tip[3:]))}°, in the vehicle's frame"]
    if not sheet.joints:
        return lines
    lines = [f"posture     {_row(sheet.posture)} rad, on which the above depends, and the tip",
             *lines, f"reach       {_row(sheet.reach[0])} to {_row(sheet.reach[1])} m"]
    if len(sheet.joints) > 2:
        least, median, here = sheet.dexterity
        lines.append(f"dexterity   the joints hold {', '.join(sheet.rows)}: σ_min(J_sq) {here:.2g} "
                     f"here, {least:.2g} at worst, median {median:.2g}")
    wide = _width(name for name, *_ in sheet.joints)
    return [*lines, "",
            f"{'joint':<{wide}}{'limits':>17}{'M':>15}{'motor in it':>18}{'damping':>9}",
            *(_joint_line(wide, *row) for row in zip(
                sheet.joints, sheet.inertia[6:], sheet.units, strict=True))]


def _width(names: Iterable[str]) -> int:
    """Returns the width of a column of names."""
    return max(14, *(len(name) + 2 for name in names))


def _joint_line(wide: int, joint: tuple[str, float, float, float, float], inertia: float,
                units: tuple[str, str, str]) -> str:
    name, lower, upper, rotor, damping = joint
    angle, mass, by_speed = units
    return (f"{name:<{wide}}{f'{lower:.4g} .. {upper:.4g}':>17} {angle:<3}{inertia:>11.3g} "
            f"{mass:<6}{rotor:>11.3g}{damping:>9.3g} {by_speed}")


def _body_lines(sheet: RobotSheet) -> list[str]:
    wide = _width(name for name, *_ in sheet.bodies)
    return [f"{'body':<{wide}}{'mass, kg':>10}{'water, kg':>11}   added mass (x, y, z), kg",
            *(f"{name:<{wide}}{mass:>10.4g}{water:>11.4g}   {_row(added)}"
              for name, mass, water, added in sheet.bodies)]


def notes_of(sheet: RobotSheet) -> list[str]:
    """Returns the notes: no mistakes, but worth knowing."""
    notes = [f"hydrodynamics.yaml, bodies.{name}.added_mass: {line}"
             for name, (line, fits) in sheet.water.items() if not fits]
    notes += [f"joint {name} has no limits: a scenario has to give limits.q_lower and q_upper"
             for name, lower, upper, *_ in sheet.joints if not np.all(np.isfinite([lower, upper]))]
    notes += [f"joint {name} has no inertia of a motor: of a gear it outweighs a light link"
              for name, _, _, rotor, _ in sheet.joints if rotor == 0.0]
    if abs(sheet.tip[4]) > STEEP:
        notes.append("the tip's x points almost straight up or down in this posture, where its "
                     "Euler angles are singular")
    if sheet.thrust is not None and sheet.thrust.hover > 1.0:
        notes.append(f"thruster {sheet.thrust.hover_thruster} is too weak to hold the robot level")
    dry = [name for name, mass, water, added in sheet.bodies
           if mass > 0.0 and water == 0.0 and not np.any(added)]
    if dry:
        notes.append(f"dry, as hydrodynamics.yaml does not name {'it' if len(dry) == 1 else 'them'}"
                     f": {', '.join(dry)}")
    if sheet.trim.righting_lever > STIFF:
        notes.append(f"the centre of buoyancy is {sheet.trim.righting_lever:.3g} m above that of "
                     "mass: of vehicles it is centimetres; all places are in m")
    return notes


def _row(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in np.round(values, 9) + 0.0) + ")"


def _swing(swing: Swing) -> str:
    if not np.isfinite(swing.period):
        return f"{swing.stiffness:.3g} N m/rad: nothing rights it"
    return (f"{swing.stiffness:.3g} N m/rad, period {swing.period:.3g} s, damping ratio "
            f"{swing.damping:.2g} at rest")


def _thrust_lines(thrust: Thrust) -> list[str]:
    rows = [f"{axis:<14}" + ("driven by none" if axis in thrust.undriven else
                             f"{most:>7.3g} /{-least:>7.3g} {unit}")
            for axis, (most, least), unit
            in zip(AXES, thrust.largest, [*["N"] * 3, *["N m"] * 3], strict=True)]
    return ["largest wrench along an axis, none along the others", *rows,
            f"at rest, {thrust.hover_thruster} gives most: {100.0 * thrust.hover:.2g} % of its "
            "limit"]
