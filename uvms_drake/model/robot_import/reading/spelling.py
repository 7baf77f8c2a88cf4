"""Refuses elements and attributes that are one of another name, mistyped.

Unknown names are passed over, for files in the wild have elements of many programs; but an
`<inertia>` in place of an `<inertial>` would lose a mass in silence.
"""

import difflib

from uvms_drake.common.errors import require
from uvms_drake.model.robot_import.reading.xml_node import Node

SHAPES = "box cylinder sphere capsule ellipsoid mesh plane polyline heightmap empty cone"
ELEMENTS = {
    "robot": "link joint material transmission frame gazebo sensor ros2_control plugin",
    "sdf": "model world light actor",
    "world": "model include plugin light physics gravity scene gui static pose atmosphere wind",
    "model": "link joint frame model include plugin pose static self_collide allow_auto_disable "
             "enable_wind gripper",
    "include": "uri name pose static placement_frame plugin merge",
    "link": "inertial visual collision sensor pose gravity self_collide enable_wind light origin "
            "kinematic must_be_base_link velocity_decay audio_source battery particle_emitter type",
    "inertial": "origin mass inertia pose fluid_added_mass density",
    "joint": "origin parent child axis limit dynamics mimic safety_controller calibration pose "
             "axis2 physics sensor thread_pitch gearbox_ratio drake:rotor_inertia "
             "drake:gear_ratio drake:mimic drake:controller_gains drake:damping",
    "axis": "xyz limit dynamics mimic use_parent_model_frame initial_position",
    "limit": "lower upper effort velocity stiffness dissipation",
    "dynamics": "damping friction spring_reference spring_stiffness",
    "visual": "origin geometry material pose meta transparency cast_shadows plugin laser_retro",
    "collision": "origin geometry pose surface max_contacts laser_retro verbose",
    "geometry": f"{SHAPES} drake:capsule drake:ellipsoid",
    "hydrodynamic_model": "type added_mass linear_damping quadratic_damping radius length "
                          "linear_damping_forward_speed scaling_added_mass offset_added_mass "
                          "scaling_damping offset_linear_damping offset_forward_speed_damping "
                          "offset_nonlin_damping",
}
"""Children of elements."""
ATTRIBUTES = {
    "link": "name type", "joint": "name type", "parent": "link", "child": "link",
    "origin": "xyz rpy", "mass": "value", "inertia": "ixx ixy ixz iyy iyz izz", "axis": "xyz",
    "limit": "lower upper effort velocity", "dynamics": "damping friction",
    "mimic": "joint multiplier offset", "box": "size", "cylinder": "radius length",
    "sphere": "radius", "mesh": "filename scale uri", "pose": "relative_to degrees rotation_format",
}
OPAQUE = ("gazebo", "transmission", "sensor", "material", "light", "ros2_control", "gui", "scene")
"""Elements that are not looked into, but for plugins of water."""
CLOSE = 0.8
"""Likeness from which a name is another one, mistyped."""


def require_spelled(node: Node) -> None:
    """Raises `InvalidParameter` for the first name that is a known one, mistyped."""
    for names, table in (([child.tag for child in node.children], ELEMENTS),
                         (list(node.attributes), ATTRIBUTES)):
        known = table.get(node.tag, "").split()
        for name in names if known else []:
            near = difflib.get_close_matches(name, known, 1, CLOSE) if name not in known else []
            require(not near, node.place(), name, f"spelled {near[0] if near else name}")
    for child in node.children:
        if child.tag in OPAQUE:
            for model in child.every("hydrodynamic_model"):
                require_spelled(model)
        elif child.tag != "plugin" or child.find("link_name") is None:
            require_spelled(child)
