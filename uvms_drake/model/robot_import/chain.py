"""Chooses vehicle and arm in a tree: the root, the chain of joints, and the fixed rest."""

import re
from dataclasses import dataclass, field

import numpy as np

from uvms_drake.common.errors import InvalidFile, InvalidParameter
from uvms_drake.model.robot_import.tree import MOVING, Joint, Notes, Tree, listed

ROTOR = re.compile(r"thruster|propell|(^|[_/:])props?([_\d]|$)|rotor|(^|[_/:])t[12]00", re.I)
JAW = re.compile(r"jaw|finger|gripper|claw|grasp|pincer", re.I)
TURNS = re.compile(r"roll|rotat|wrist|yaw|twist", re.I)
ARM = re.compile(r"arm|manip|shoulder|elbow|wrist|gripper|jaw|finger|alpha|bravo|oberon|tool", re.I)
CAMERA = re.compile(
    r"cam(era)?s?(?![a-z])|gimbal|ptz|ptu|lens|lidar|laser|sonar|(^|[_/:])(pan|tilt|lights?|lamps?|"
    r"head|mast|stereo|zed|imager|multibeam)([_\d]|$)", re.I)
TOOL = re.compile(r"(^|[_/:])(tip|tcp|ee)([_/:]|$)|end_?eff|tool|grasp|grip", re.I)
SEES = re.compile("camera|depth|ray|lidar|sonar", re.I)
"""Types of sensors that a joint may point."""
WEAK = 0.2
"""Share of the largest effort below which joints drive no arm."""
SIDES = re.compile(r"left|right|[_/]?[lr]([_/]|$)|\d+", re.I)
NARROW = 1e-9
"""Range of a joint that is none [rad, m]."""


@dataclass
class Chain:
    """Vehicle and arm of a tree."""

    root: str
    """The link that gives the vehicle its frame."""
    joints: list[Joint]
    """The arm's joints, from the vehicle outwards."""
    groups: list[list[str]] = field(default_factory=list)
    """Links that move as one: those of the vehicle, and those beyond each joint."""


def choose_chain(tree: Tree, rotors: set[str], notes: Notes) -> Chain:
    """Returns vehicle and arm, every other joint fixed, and notes the choices.

    Args:
        tree: The robot; joints that are fixed off zero are moved there.
        rotors: Joints that thrusters are known by.
        notes: To which the choice is added.

    Raises:
        InvalidParameter: It is not one tree.
    """
    # Joints that may be the arm's, and the paths that they make from the root.
    root = _root(tree, notes)
    inside = set(tree.beyond(root))
    joints = [joint for joint in tree.joints.values() if joint.parent in inside]
    why = {joint.name: reason for joint in joints
           if (reason := _reason_to_fix(joint, rotors)) is not None}
    free = [joint for joint in joints if joint.name not in why and joint.kind in MOVING]
    paths = _paths(root, joints, free)
    # The best path, jaws at its end not counted; all others are fixed.
    whole = [_without_jaws(path, joints, free) for path in paths]
    eyes = [path for path in whole if path and _is_camera(path, tree, joints)]
    stripped = [path for path in whole if path and path not in eyes]
    strongest = max((joint.effort for path in stripped for joint in path), default=0.0)
    best = max(range(len(stripped)), key=lambda i: (
        _carries_tool(stripped[i], tree, joints), _effort(stripped[i]) >= WEAK * strongest,
        len(stripped[i]), sum(bool(ARM.search(joint.name + joint.child)) for joint in stripped[i]),
        -i), default=None)
    arm = [] if best is None else stripped[best]
    _tell_rivals(arm, stripped, notes)
    watching = [joint for path in eyes for joint in path if joint not in arm]
    why |= {joint.name: "a camera" for joint in watching}
    if watching:
        names = listed([joint.name for joint in watching])
        notes.asked.append(f"the arm: {names} taken for the mount of a camera or lamp, by names or "
                           "sensors, and fixed. If that is the arm, give it a link without a mass "
                           "that is called tool_tip, and begin again")
    jaws = {joint.name for path in paths for joint in path if path[:len(arm)] == arm}
    for joint in free:
        if joint not in arm and joint.name not in why:
            why[joint.name] = "a jaw" if joint.name in jaws and arm else "not in the chain"
    _fix(tree, joints, why, notes)
    # Mistakes that change nothing where a joint is fixed.
    if wrong := [f"{joint.node.file}: {each}" for joint in arm for each in joint.node.mistakes]:
        raise InvalidFile(wrong)
    if wrong := [each.partition(": must be")[0]
                 for joint in joints for each in joint.node.mistakes]:
        notes.changed.append("limits and losses of joints that are fixed here, not read for a "
                             f"mistake in them: {listed(wrong)}")
    # Links that move as one; the heaviest of the vehicle's gives the frame if the root is a dummy.
    chain = Chain(root, arm)
    starts = [root, *(joint.child for joint in arm)]
    chain.groups = [_welded(start, joints, arm) for start in starts]
    if tree.links[root].mass <= 0.0:
        chain.root = max(chain.groups[0], key=lambda name: tree.links[name].mass)
        if chain.root != root:
            notes.changed.append(f"root '{root}' has no mass: skipped; the vehicle's frame is that "
                                 f"of the heaviest link that is fixed to it, '{chain.root}'")
    others = [name for name in chain.groups[0] if name != chain.root] or ["nothing else"]
    notes.taken.append(f"vehicle: link '{chain.root}' of {tree.links[chain.root].mass:g} kg, with "
                       f"these fixed to it: {listed(others)}")
    notes.taken.append(f"arm: {len(arm)} joints, {listed([joint.name for joint in arm], 20)}"
                       if arm else "arm: none, for no joint moves; the tool is bolted on")
    return chain


def _root(tree: Tree, notes: Notes) -> str:
    """Returns the link on which all others hang."""
    parents: dict[str, Joint] = {}
    for joint in tree.joints.values():
        if joint.child in parents:
            raise InvalidParameter(joint.node.place(), joint.child, "the child of one joint: "
                                   f"'{parents[joint.child].name}' has it already (a closed loop)")
        parents[joint.child] = joint
    roots = [name for name in tree.links if name not in parents]
    roots.sort(key=lambda name: -len(tree.beyond(name)))
    if not roots:
        raise InvalidParameter("--from", str(next(iter(tree.joints.values())).node.file),
                               "a tree of links with a root")
    lost = [name for name in roots[1:] if tree.links[name].mass > 0.0]
    if lost:
        raise InvalidParameter(tree.links[lost[0]].node.place(), listed(lost),
                               f"joined to '{roots[0]}' by a joint, as all links of a robot are")
    notes.changed += [f"link '{name}', which has no mass and is joined to nothing: left out"
                      for name in roots[1:] if len(tree.beyond(name)) == 1
                      and not any(name in said for said in notes.changed)]
    return roots[0]


def _reason_to_fix(joint: Joint, rotors: set[str]) -> str | None:
    """Returns the reason why a joint cannot be one of the arm, None if it may."""
    if joint.name in rotors or ROTOR.search(joint.name) or ROTOR.search(joint.child):
        return "a rotor" if joint.kind != "fixed" else None
    if joint.kind == "fixed":
        return None
    if joint.mimic is not None:
        return f"mimics '{joint.mimic[0]}'"
    if joint.kind not in MOVING:
        return f"of type {joint.kind}"
    if joint.upper - joint.lower <= NARROW:
        return f"limits {joint.lower:g}..{joint.upper:g}"
    return None


def _paths(root: str, joints: list[Joint], free: list[Joint]) -> list[list[Joint]]:
    """Returns the sequences of free joints from the root to every link on which nothing hangs."""
    found: list[list[Joint]] = []
    stack: list[tuple[str, list[Joint]]] = [(root, [])]
    while stack:
        link, path = stack.pop()
        below = [joint for joint in joints if joint.parent == link]
        if not below:
            found.append(path)
        stack += [(joint.child, [*path, joint] if joint in free else path)
                  for joint in reversed(below)]
    return [path for i, path in enumerate(found) if path and path not in found[:i]]


def _without_jaws(path: list[Joint], joints: list[Joint], free: list[Joint]) -> list[Joint]:
    """Returns a path without the joints at its end that open a gripper."""
    mimicked = {joint.mimic[0] for joint in joints if joint.mimic is not None}
    while path and (_is_jaw(path[-1], mimicked) or (
            len(path) > 1 and any(_are_twins(path[-1], other) for other in joints))):
        path = path[:-1]
    return path


def _is_jaw(joint: Joint, mimicked: set[str]) -> bool:
    named = JAW.search(joint.name) or JAW.search(joint.child)
    return joint.name in mimicked or bool(named and not TURNS.search(joint.name))


def _are_twins(joint: Joint, other: Joint) -> bool:
    """Whether two joints on one link are left and right of each other."""
    return (other is not joint and other.parent == joint.parent and other.kind == joint.kind
            and SIDES.sub("", other.name) == SIDES.sub("", joint.name) != joint.name)


def _carries_tool(path: list[Joint], tree: Tree, joints: list[Joint]) -> bool:
    """Whether a tool's name is beyond the path: of a frame, of a link, or of jaws."""
    beyond = set(tree.beyond(path[-1].child))
    names = [*beyond, *(joint.name for joint in joints if joint.parent in beyond),
             *(name for name, (link, _) in tree.frames.items() if link in beyond)]
    return any(TOOL.search(name) or JAW.search(name) for name in names)


def _effort(path: list[Joint]) -> float:
    """Returns the largest effort of its joints; without any, one that is enough."""
    return max(joint.effort for joint in path) or np.inf


def _is_camera(path: list[Joint], tree: Tree, joints: list[Joint]) -> bool:
    """Whether a path turns a camera or a lamp: by its names, or by the sensors that it carries."""
    if _carries_tool(path, tree, joints):
        return False
    names = [re.split("/|::", name)[-1] for joint in path for name in (joint.name, joint.child)]
    named = sum(bool(CAMERA.search(name)) for name in names)
    sees = any(SEES.search(kind) for link in tree.beyond(path[0].child)
               for kind in tree.links[link].sensors)
    return named + sees * len(path) > sum(bool(ARM.search(name)) for name in names)


def _tell_rivals(arm: list[Joint], paths: list[list[Joint]], notes: Notes) -> None:
    """Says which other arms were left out."""
    noted: list[Joint] = []
    for path in sorted(paths, key=len, reverse=True):
        if path[0] is not arm[0] and path[0] not in noted and len(path) > 1:
            noted.append(path[0])
            notes.changed.append(
                f"another arm, of '{path[0].name}' to '{path[-1].name}', is fixed: a robot has one "
                "here; taken was the one that carries a tool, is strong, is longer or has the "
                "better names, in this order")


def _fix(tree: Tree, joints: list[Joint], why: dict[str, str], notes: Notes) -> None:
    """Moves joints to where they are fixed, as near to zero as limits allow, and lists them."""
    at: dict[str, float] = {}
    for joint in joints:
        if joint.name not in why or joint.kind not in MOVING:
            continue
        target = 0.0
        if joint.mimic is not None:
            target = joint.mimic[1] * at.get(joint.mimic[0], 0.0) + joint.mimic[2]
        at[joint.name] = float(np.clip(target, joint.lower, joint.upper))
    tree.hold(at)
    reasons: dict[str, list[str]] = {}
    for name, reason in why.items():
        where = f" at {at[name]:.4g}" if at.get(name, 0.0) != 0.0 else ""
        reasons.setdefault(reason, []).append(f"{name}{where}")
    notes.changed += [f"fixed, {reason}: {listed(names)}" for reason, names in reasons.items()]


def _welded(start: str, joints: list[Joint], arm: list[Joint]) -> list[str]:
    """Returns a link and all that is fixed to it."""
    found = [start]
    for name in found:
        found += [joint.child for joint in joints if joint.parent == name and joint not in arm]
    return found
