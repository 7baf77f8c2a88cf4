"""The elements of URDF and SDFormat that a robot's file may have, and those that are not read.

Each table names an element by its tag, or by that of its parent and its own where a tag has two
meanings. An element in neither table is unknown.
"""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Value:
    """The kind of a text: numbers, words of a list, or any text."""

    numbers: int = 0
    """Count of numbers, separated by spaces; 0: it is no number."""
    infinite: bool = False
    """Whether a number may be infinite."""
    words: tuple[str, ...] = ()
    """All that are allowed; empty: any."""
    length: bool = False
    """Whether the numbers are a place [m]: the first three, of which none is far away."""
    positive: bool = False
    """Whether the numbers are sizes."""


TEXT = Value()
NUMBER, THREE, FOUR = Value(1), Value(3), Value(4)
SIZE, SIZES = Value(1, positive=True), Value(3, positive=True)
PLACE, POSE = Value(3, length=True), Value(6, length=True)
LIMIT = Value(1, infinite=True)
YES_NO = Value(words=("true", "false", "1", "0"))
YES, NO = Value(words=("true", "1")), Value(words=("false", "0"))


@dataclass(frozen=True)
class Element:
    """Names and kinds of children and attributes of an element; names are separated by spaces."""

    attributes: dict[str, Value] = field(default_factory=dict)
    text: Value | None = None
    once: str = ""
    """Children that are there once at most."""
    many: str = ""
    """Children that may be there several times."""
    needs: str = ""
    """Attributes and children that must be there."""
    unread: str = ""
    """Children and attributes with a meaning elsewhere, which are reported as not read."""
    quiet: str = ""
    """Elements about looks or contact of shapes: nothing here depends on them."""
    kept: str = ""
    """Children that are left to Drake as they are, with all below them."""


INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
DRAKE = ("drake:linear_bushing_rpy drake:ball_constraint drake:distance_constraint "
         "drake:tendon_constraint drake:prismatic_spring drake:linear_spring_damper")
"""Forces and constraints, each of which is refused once it is in the plant."""
FILTERS = "drake:collision_filter_group collision_filter_group"
LOOKS = ("transparency cast_shadows laser_retro visibility_flags meta plugin "
         "drake:accepting_renderer drake:perception_properties "
         "drake:illustration_properties drake:proximity_properties")

URDF: dict[str, Element] = {
    "robot": Element(
        {"name": TEXT, "version": TEXT}, many="link joint material transmission frame",
        needs="name", unread="gazebo sensor ros2_control plugin",
        quiet=FILTERS, kept=DRAKE),
    "link": Element({"name": TEXT}, once="inertial", many="visual", needs="name",
                    unread="collision sensor self_collide gravity type", quiet="contact"),
    "inertial": Element(once="origin mass inertia", needs="mass inertia"),
    "origin": Element({"xyz": PLACE, "rpy": THREE}),
    "mass": Element({"value": NUMBER}, needs="value"),
    "inertia": Element(dict.fromkeys(INERTIA, NUMBER), needs="ixx iyy izz"),
    "visual": Element({"name": TEXT}, once="origin geometry material", needs="geometry",
                      quiet=LOOKS),
    "geometry": Element(once="box cylinder sphere mesh capsule drake:capsule drake:ellipsoid"),
    "box": Element({"size": SIZES}, needs="size"),
    "cylinder": Element({"radius": SIZE, "length": SIZE}, needs="radius length"),
    "sphere": Element({"radius": SIZE}, needs="radius"),
    "capsule": Element({"radius": SIZE, "length": SIZE}, needs="radius length"),
    "drake:capsule": Element({"radius": SIZE, "length": SIZE}, needs="radius length"),
    "drake:ellipsoid": Element({"a": SIZE, "b": SIZE, "c": SIZE}, needs="a b c"),
    "mesh": Element({"filename": TEXT, "scale": THREE}, needs="filename",
                    quiet="drake:declare_convex"),
    "material": Element({"name": TEXT}, once="color", quiet="texture"),
    "color": Element({"rgba": FOUR}, needs="rgba"),
    "joint": Element(
        {"name": TEXT, "type": Value(words=("revolute", "continuous", "prismatic", "fixed"))},
        once="origin parent child axis limit dynamics", needs="name type parent child",
        unread="calibration safety_controller drake:controller_gains"),
    "parent": Element({"link": TEXT}, needs="link"),
    "child": Element({"link": TEXT}, needs="link"),
    "axis": Element({"xyz": THREE}, needs="xyz"),
    "limit": Element({"lower": LIMIT, "upper": LIMIT, "effort": LIMIT, "velocity": LIMIT},
                     unread="drake:acceleration drake:jerk"),
    "dynamics": Element({"damping": NUMBER, "friction": NUMBER}, unread="coulomb_window"),
    "transmission": Element({"name": TEXT}, once="type actuator", many="joint",
                            needs="type joint actuator"),
    "type": Element(text=TEXT),
    "transmission joint": Element({"name": TEXT}, needs="name", quiet="hardwareInterface"),
    "actuator": Element(
        {"name": TEXT}, once="drake:rotor_inertia drake:gear_ratio", needs="name",
        unread="mechanicalReduction drake:controller_gains motorTorqueConstant",
        quiet="hardwareInterface"),
    "drake:rotor_inertia": Element({"value": NUMBER}, needs="value"),
    "drake:gear_ratio": Element({"value": NUMBER}, needs="value"),
    "frame": Element({"name": TEXT, "link": TEXT, "xyz": PLACE, "rpy": THREE},
                     needs="name link xyz rpy"),
}

_POSE = Element({"relative_to": TEXT, "degrees": YES_NO,
                 "rotation_format": Value(words=("euler_rpy", "quat_xyzw"))}, text=POSE)
SDFORMAT: dict[str, Element] = {
    "sdf": Element({"version": TEXT}, once="model", needs="version model"),
    "model": Element(
        {"name": TEXT, "canonical_link": TEXT, "placement_frame": TEXT},
        once="pose static", many="link joint frame include", needs="name",
        unread="plugin self_collide enable_wind gripper", quiet=f"allow_auto_disable {FILTERS}",
        kept=DRAKE),
    "static": Element(text=NO),
    "include": Element({"merge": YES_NO}, once="uri name pose placement_frame static",
                       needs="uri", unread="plugin"),
    "uri": Element(text=TEXT),
    "name": Element(text=TEXT),
    "placement_frame": Element(text=TEXT),
    "pose": _POSE,
    "link": Element(
        {"name": TEXT}, once="pose inertial gravity", many="visual", needs="name",
        unread="collision sensor light enable_wind velocity_decay plugin battery projector "
        "kinematic particle_emitter audio_sink audio_source must_be_base_link",
        quiet="self_collide"),
    "gravity": Element(text=YES),
    "inertial": Element({"auto": NO}, once="pose mass inertia", needs="mass inertia"),
    "mass": Element(text=NUMBER),
    "inertia": Element(once=" ".join(INERTIA), needs="ixx iyy izz"),
    **{name: Element(text=NUMBER) for name in INERTIA},
    "visual": Element({"name": TEXT}, once="pose geometry material", needs="name geometry",
                      quiet=LOOKS),
    "geometry": Element(once="box cylinder sphere capsule ellipsoid mesh drake:capsule",
                        quiet="empty"),
    "box": Element(once="size", needs="size"),
    "size": Element(text=SIZES),
    "cylinder": Element(once="radius length", needs="radius length"),
    "sphere": Element(once="radius", needs="radius"),
    "capsule": Element(once="radius length", needs="radius length"),
    "drake:capsule": Element(once="radius length", needs="radius length"),
    "ellipsoid": Element(once="radii", needs="radii"),
    "radius": Element(text=SIZE),
    "length": Element(text=SIZE),
    "radii": Element(text=SIZES),
    "mesh": Element(once="uri scale", needs="uri",
                    quiet="submesh drake:declare_convex convex_decomposition optimization"),
    "scale": Element(text=THREE),
    "material": Element(
        once="diffuse", quiet="ambient specular emissive script shader pbr lighting double_sided "
        "render_order shininess drake:diffuse_map"),
    "diffuse": Element(text=FOUR),
    "joint": Element(
        {"name": TEXT, "type": Value(words=("revolute", "continuous", "prismatic", "fixed"))},
        once="pose parent child axis drake:rotor_inertia drake:gear_ratio",
        needs="name type parent child", unread="sensor physics plugin gearbox_ratio thread_pitch "
        "screw_thread_pitch gearbox_reference_body drake:controller_gains"),
    "parent": Element(text=TEXT),
    "child": Element(text=TEXT),
    "axis": Element(once="xyz limit dynamics", needs="xyz", unread="initial_position"),
    "xyz": Element({"expressed_in": TEXT}, text=THREE),
    "limit": Element(once="lower upper effort velocity",
                     unread="stiffness dissipation drake:acceleration"),
    **{name: Element(text=LIMIT) for name in ("lower", "upper", "effort", "velocity")},
    "dynamics": Element(once="damping friction spring_reference spring_stiffness"),
    **{name: Element(text=NUMBER) for name in (
        "damping", "friction", "spring_reference", "spring_stiffness",
        "drake:rotor_inertia", "drake:gear_ratio")},
    "frame": Element({"name": TEXT, "attached_to": TEXT}, once="pose", needs="name"),
    "use_parent_model_frame": Element(text=YES_NO),
    "hydrodynamic_model": Element(  # Of a plugin.
        once="type added_mass linear_damping quadratic_damping radius length "
        "linear_damping_forward_speed scaling_added_mass offset_added_mass scaling_damping "
        "offset_linear_damping offset_forward_speed_damping offset_nonlin_damping"),
}

for _table in (URDF, SDFORMAT):
    _table["collision"] = _table["visual"]  # Read of files of others only.

REFUSED = {
    "fluid_added_mass": "left out: added mass is in hydrodynamics.yaml, bodies.<link>.added_mass",
    "density": "left out: an inertial is given by mass and inertia",
    "auto_inertia_params": "left out: an inertial is given by mass and inertia",
    "mimic": "left out: the arm is a chain without mimicking joints; a jaw is to be of type fixed",
    "drake:mimic": "left out: the arm is a chain without mimicking joints; a jaw is to be of type "
                   "fixed",
    "axis2": "left out: a joint has one axis",
    "drake:joint": "a joint of type revolute, continuous, prismatic or fixed",
    "use_parent_model_frame": "left out: the axis is in the joint's frame, or has expressed_in",
    "world": "left out: the file has one model",
}
"""Elements that would change the robot and that Drake or this project does not take, by tag."""


def spec_of(table: dict[str, Element], parent: str, tag: str) -> Element:
    """Returns the element of a table by its tag and that of its parent."""
    return table.get(f"{parent} {tag}", table[tag])
