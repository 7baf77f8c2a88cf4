"""The elements of URDF and SDFormat that a robot's file may have, and those that are not read.

Each table names an element by its tag, or by that of its parent and its own where a tag has two
meanings. An element in neither table is unknown.
"""

from dataclasses import dataclass, replace


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


TEXT, NUMBER, THREE = Value(), Value(1), Value(3)
VALUES = {
    **dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz", "damping", "friction",
                     "spring_reference", "spring_stiffness", "mass", "value",
                     "drake:rotor_inertia", "drake:gear_ratio"), NUMBER),
    **dict.fromkeys(("radius", "length", "a", "b", "c"), Value(1, positive=True)),
    **dict.fromkeys(("size", "radii"), Value(3, positive=True)),
    **dict.fromkeys(("lower", "upper", "effort", "velocity"), Value(1, infinite=True)),
    **dict.fromkeys(("scale", "rpy", "xyz"), THREE), "diffuse": Value(4), "rgba": Value(4),
    "origin xyz": Value(3, length=True), "frame xyz": Value(3, length=True),
    "pose": Value(6, length=True), "rotation_format": Value(words=("euler_rpy", "quat_xyzw")),
    "joint type": Value(words=("revolute", "continuous", "prismatic", "fixed")),
    **dict.fromkeys(("degrees", "merge", "use_parent_model_frame"),
                    Value(words=("true", "false", "1", "0"))),
    "gravity": Value(words=("true", "1")), "static": Value(words=("false", "0")),
    "auto": Value(words=("false", "0")),
}
"""Kinds of texts by the name of the attribute or element, or by that of its parent, too; all
others are any text."""


@dataclass(frozen=True)
class Element:
    """Names of the children and attributes of an element, separated by spaces."""

    attributes: str = ""
    values: str = ""
    """Numbers in it: attributes of URDF, elements of SDFormat."""
    once: str = ""
    """Children that are there once at most."""
    many: str = ""
    """Children that may be there several times."""
    needs: str = ""
    """Attributes, values and children that must be there."""
    unread: str = ""
    """Children and attributes with a meaning elsewhere, which are reported as not read."""
    quiet: str = ""
    """Elements about looks or contact of shapes: nothing here depends on them."""
    kept: str = ""
    """Children that are left to Drake as they are, with all below them."""
    text: Value | None = None


DRAKE = ("drake:linear_bushing_rpy drake:ball_constraint drake:distance_constraint "
         "drake:tendon_constraint drake:prismatic_spring drake:linear_spring_damper")
"""Forces and constraints, each of which is refused once it is in the plant."""
FILTERS = "drake:collision_filter_group collision_filter_group"
LOOKS = ("transparency cast_shadows laser_retro visibility_flags meta plugin "
         "drake:accepting_renderer drake:perception_properties "
         "drake:illustration_properties drake:proximity_properties")

BOTH = {
    "inertia": Element(values="ixx iyy izz ixy ixz iyz", needs="ixx iyy izz"),
    "box": Element(values="size", needs="size"),
    "sphere": Element(values="radius", needs="radius"),
    **dict.fromkeys(("cylinder", "capsule", "drake:capsule"),
                    Element(values="radius length", needs="radius length")),
    "limit": Element(values="lower upper effort velocity",
                     unread="stiffness dissipation drake:acceleration drake:jerk"),
}
URDF = BOTH | {
    "robot": Element("name version", many="link joint material transmission frame", needs="name",
                     unread="gazebo sensor ros2_control plugin", quiet=FILTERS, kept=DRAKE),
    "link": Element("name", once="inertial", many="visual", needs="name",
                    unread="collision sensor self_collide gravity type", quiet="contact"),
    "inertial": Element(once="origin mass inertia", needs="mass inertia"),
    "origin": Element("xyz rpy"),
    "visual": Element("name", once="origin geometry material", needs="geometry", quiet=LOOKS),
    "geometry": Element(once="box cylinder sphere mesh capsule drake:capsule drake:ellipsoid"),
    "drake:ellipsoid": Element("a b c", needs="a b c"),
    "mesh": Element("filename scale", needs="filename", quiet="drake:declare_convex"),
    "material": Element("name", once="color", quiet="texture"),
    "color": Element("rgba", needs="rgba"),
    "joint": Element("name type", once="origin parent child axis limit dynamics",
                     needs="name type parent child",
                     unread="calibration safety_controller drake:controller_gains"),
    **dict.fromkeys(("parent", "child"), Element("link", needs="link")),
    "axis": Element("xyz", needs="xyz"),
    "dynamics": Element("damping friction", unread="coulomb_window"),
    "transmission": Element("name", once="type actuator", many="joint",
                            needs="type joint actuator"),
    "type": Element(text=TEXT),
    "transmission joint": Element("name", needs="name", quiet="hardwareInterface"),
    "actuator": Element("name", once="drake:rotor_inertia drake:gear_ratio", needs="name",
                        unread="mechanicalReduction drake:controller_gains motorTorqueConstant",
                        quiet="hardwareInterface"),
    **dict.fromkeys(("mass", "drake:rotor_inertia", "drake:gear_ratio"),
                    Element("value", needs="value")),
    "frame": Element("name link xyz rpy", needs="name link xyz rpy"),
}
SDFORMAT = BOTH | {
    "sdf": Element("version", once="model", needs="version model"),
    "model": Element(
        "name canonical_link placement_frame", "static", "pose", "link joint frame include", "name",
        unread="plugin self_collide enable_wind gripper", quiet=f"allow_auto_disable {FILTERS}",
        kept=DRAKE),
    "include": Element("merge", "uri name placement_frame static", "pose", needs="uri",
                       unread="plugin"),
    "pose": Element("relative_to degrees rotation_format", text=VALUES["pose"]),
    "link": Element(
        "name", "gravity", "pose inertial", "visual", "name",
        unread="collision sensor light enable_wind velocity_decay plugin battery projector "
        "kinematic particle_emitter audio_sink audio_source must_be_base_link",
        quiet="self_collide"),
    "inertial": Element("auto", "mass", "pose inertia", needs="mass inertia"),
    "visual": Element("name", once="pose geometry material", needs="name geometry", quiet=LOOKS),
    "geometry": Element(once="box cylinder sphere capsule ellipsoid mesh drake:capsule",
                        quiet="empty"),
    "ellipsoid": Element(values="radii", needs="radii"),
    "mesh": Element(values="uri scale", needs="uri", quiet="submesh drake:declare_convex "
                    "convex_decomposition optimization"),
    "material": Element(values="diffuse", quiet="ambient specular emissive script shader pbr "
                        "lighting double_sided render_order shininess drake:diffuse_map"),
    "joint": Element("name type", "parent child drake:rotor_inertia drake:gear_ratio", "pose axis",
                     needs="name type parent child", unread="sensor physics plugin gearbox_ratio "
                     "thread_pitch screw_thread_pitch gearbox_reference_body "
                     "drake:controller_gains"),
    "axis": Element(once="xyz limit dynamics", needs="xyz", unread="initial_position"),
    "xyz": Element("expressed_in", text=THREE),
    "dynamics": Element(values="damping friction spring_reference spring_stiffness"),
    "frame": Element("name attached_to", once="pose", needs="name"),
    "use_parent_model_frame": Element(text=VALUES["use_parent_model_frame"]),
    "hydrodynamic_model": Element(  # Of a plugin.
        once="type added_mass linear_damping quadratic_damping radius length "
        "linear_damping_forward_speed scaling_added_mass offset_added_mass scaling_damping "
        "offset_linear_damping offset_forward_speed_damping offset_nonlin_damping"),
}
# Values are attributes in the one format, elements with a text in the other.
URDF = {tag: replace(spec, attributes=f"{spec.attributes} {spec.values}".strip())
        for tag, spec in URDF.items()}
SDFORMAT = {name: Element(text=VALUES.get(name, TEXT)) for spec in SDFORMAT.values()
            for name in spec.values.split()} | {
    tag: replace(spec, once=f"{spec.values} {spec.once}".strip()) for tag, spec in SDFORMAT.items()}
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


def kind_of(parent: str, name: str) -> Value:
    """Returns the kind of an attribute or of the text of an element."""
    return VALUES.get(f"{parent} {name}", VALUES.get(name, TEXT))


def spec_of(table: dict[str, Element], parent: str, tag: str) -> Element:
    """Returns the element of a table by its tag and that of its parent."""
    return table.get(f"{parent} {tag}", table[tag])
