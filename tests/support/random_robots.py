"""Legal robots at random, in URDF or SDFormat: arms of up to seven joints, and their shapes."""

from pathlib import Path

import numpy as np
import yaml

OBJ = "v 0 0 0\nv 0.2 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
STL = ("solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 0.2 0 0\nvertex 0 0.1 0.1\n"
       "endloop\nendfacet\nendsolid s\n")
MESHES = ("package://{robot}/part.obj", "part.stl", "package://nobody/part.dae", "missing.obj")


def write_random_robot(folder: Path, rng: np.random.Generator) -> Path:
    """Returns the folder of a robot that presses some newtons at least: strong and near neutral."""
    n, urdf = int(rng.integers(0, 8)), bool(rng.random() < 0.5)
    robot = folder / f"robot{n}{'u' if urdf else 's'}"
    robot.mkdir(parents=True)
    mass, size = float(rng.uniform(30.0, 200.0)), rng.uniform(0.3, 1.0, 3)
    links = [_link("vehicle", mass, size, np.array([0.0, 0.0, rng.uniform(0.01, 0.06)]), rng)]
    water = {"vehicle": _water(mass * float(rng.uniform(1.0, 1.03)), size,
                               [0.0, 0.0, -float(rng.uniform(0.01, 0.06))])}
    joints, parent, offset = [], "vehicle", np.array([0.5 * size[0], 0.0, 0.3 * size[2]])
    length = 0.9 / max(n, 2)
    for i in range(1, n + 1):
        own = mass / 60.0 / n * float(rng.uniform(0.5, 1.5))
        links.append(_link(f"link{i}", own, np.array([length, 0.06, 0.06]),
                           np.array([0.5 * length, 0.0, 0.0]), rng))
        if rng.random() < 0.8:
            water[f"link{i}"] = _water(own * float(rng.uniform(0.6, 0.9)),
                                       np.array([length, 0.06, 0.06]), [0.5 * length, 0.0, 0.0])
        joints.append(_joint(i, parent, f"link{i}", offset, rng))
        parent, offset = f"link{i}", np.array([length, 0.0, 0.0])
    fixed = []
    for k in range(int(rng.integers(0, 3))):  # Joints off the chain.
        links.append(_link(f"part{k}", 0.3, np.full(3, 0.1), np.zeros(3), rng))
        fixed.append((f"part{k}_joint", rng.choice(["vehicle", parent]), f"part{k}",
                      rng.uniform(-0.2, 0.2, 3)))
    text = (_urdf if urdf else _sdf)(robot.name, links, joints, fixed, parent, offset, rng)
    (robot / f"{robot.name}.{'urdf' if urdf else 'sdf'}").write_text(text, encoding="utf-8")
    (robot / "hydrodynamics.yaml").write_text(yaml.safe_dump({"bodies": water}), encoding="utf-8")
    (robot / "package.xml").write_text(
        f'<package format="2"><name>{robot.name}</name></package>', encoding="utf-8")
    (robot / "part.obj").write_text(OBJ, encoding="utf-8")
    (robot / "part.stl").write_text(STL, encoding="utf-8")
    if rng.random() < 0.5:
        (robot / "thrusters.yaml").write_text(yaml.safe_dump(
            _thrusters(size, mass, rng), sort_keys=False), encoding="utf-8")
    return robot


def _link(name: str, mass: float, size: np.ndarray, com: np.ndarray, rng: np.random.Generator
          ) -> dict:
    moments = mass / 12.0 * (np.sum(size**2) - size**2)
    shape = rng.choice(["none", "box", "cylinder", "sphere", "mesh", "mesh"])
    return {"name": name, "mass": mass, "size": size, "com": com, "moments": moments,
            "shape": shape, "mesh": rng.choice(MESHES), "collides": rng.random() < 0.3}


def _water(displaced: float, size: np.ndarray, center: list[float]) -> dict:
    added = displaced * np.array([0.5, 0.9, 1.1, *(size**2 / 6.0)])
    return {"displaced_volume": displaced / 1000.0, "center_of_buoyancy": center,
            "added_mass": [{"matrix": added.tolist(), "point": center}],
            "drag": [{"linear": (0.3 * added).tolist(), "quadratic": (2.0 * added).tolist()}]}


def _joint(i: int, parent: str, child: str, offset: np.ndarray, rng: np.random.Generator) -> dict:
    kind = "prismatic" if i > 1 and rng.random() < 0.15 else (
        "continuous" if rng.random() < 0.15 else "revolute")
    axis = np.eye(3)[0 if kind == "prismatic" else rng.choice([1, 1, 2, 0])]
    if rng.random() < 0.3:
        axis = axis + rng.uniform(-0.3, 0.3, 3)
    low = -float(rng.uniform(0.6, 2.8))
    limits = None if kind == "continuous" else (
        (-0.1, 0.3) if kind == "prismatic" else (low, low + float(rng.uniform(1.0, 3.0))))
    return {"name": f"joint{i}", "type": kind, "parent": parent, "child": child, "offset": offset,
            "axis": axis, "limits": limits, "damping": float(rng.uniform(0.5, 3.0)),
            "rpy": rng.uniform(-0.4, 0.4, 3) if rng.random() < 0.3 else np.zeros(3)}


def _thrusters(size: np.ndarray, mass: float, rng: np.random.Generator) -> dict:
    """Returns six or eight thrusters that drive all axes, or four that leave roll and pitch."""
    x, y, z = 0.5 * size
    places = {"aft1": ([-x, y, 0], [1, 0, 0]), "aft2": ([-x, -y, 0], [1, 0, 0]),
              "side1": ([x, 0, z], [0, 1, 0]), "side2": ([-x, 0, -z], [0, 1, 0])}
    up = {f"up{i}": ([sx * x, sy * y, 0], [0, 0, 1])
          for i, (sx, sy) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1)))}
    most = 4.0 * mass
    return {"kinds": {"one": {"lag": float(rng.uniform(0.03, 0.12)), "curves": [
        {"command": [-1.0, 0.0, 1.0], "force": [-most, 0.0, most]}]}},
        "thrusters": {name: {"kind": "one", "position": [float(p) for p in place], "axis": axis}
                      for name, (place, axis) in (places | up).items()}}


def _numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def _urdf(name: str, links: list[dict], joints: list[dict], fixed: list[tuple], last: str,
          offset: np.ndarray, rng: np.random.Generator) -> str:
    parts = []
    for link in links:
        xx, yy, zz = link["moments"]
        shape = {"none": "", "box": f'<box size="{_numbers(link["size"])}"/>',
                 "cylinder": '<cylinder radius="0.05" length="0.2"/>',
                 "sphere": '<sphere radius="0.1"/>',
                 "mesh": f'<mesh filename="{link["mesh"].format(robot=name)}"/>'}[link["shape"]]
        parts.append(
            f'<link name="{link["name"]}"><inertial><origin xyz="{_numbers(link["com"])}"/><mass '
            f'value="{link["mass"]:.9g}"/><inertia ixx="{xx:.9g}" iyy="{yy:.9g}" izz="{zz:.9g}" '
            'ixy="0" ixz="0" iyz="0"/></inertial>'
            + (f"<visual><geometry>{shape}</geometry></visual>" if shape else "")
            + ('<collision><geometry><mesh filename="no.stl"/></geometry></collision>'
               if link["collides"] else "") + "</link>")
    for joint in joints:
        limits = "" if joint["limits"] is None else (
            f'lower="{joint["limits"][0]:.9g}" upper="{joint["limits"][1]:.9g}" ')
        parts.append(
            f'<joint name="{joint["name"]}" type="{joint["type"]}"><parent link='
            f'"{joint["parent"]}"/><child link="{joint["child"]}"/><origin xyz='
            f'"{_numbers(joint["offset"])}" rpy="{_numbers(joint["rpy"])}"/><axis xyz='
            f'"{_numbers(joint["axis"])}"/><limit {limits}effort="150" velocity="1"/><dynamics '
            f'damping="{joint["damping"]:.9g}"/></joint><transmission name="t_{joint["name"]}">'
            f'<type>SimpleTransmission</type><joint name="{joint["name"]}"/><actuator name='
            f'"m_{joint["name"]}"><drake:rotor_inertia value="5e-5"/><drake:gear_ratio '
            'value="100"/></actuator></transmission>')
    parts += [f'<joint name="{joint}" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
              f'<origin xyz="{_numbers(place)}"/></joint>' for joint, parent, child, place in fixed]
    rng.shuffle(parts)
    return (f'<robot name="{name}" xmlns:drake="http://drake.mit.edu">' + "\n".join(parts)
            + f'<frame name="tip" link="{last}" xyz="{_numbers(offset)}" rpy="0 0 0"/></robot>')


def _sdf(name: str, links: list[dict], joints: list[dict], fixed: list[tuple], last: str,
         offset: np.ndarray, rng: np.random.Generator) -> str:
    places = {joint["child"]: (joint["parent"], joint["offset"], joint["rpy"]) for joint in joints}
    places |= {child: (parent, place, np.zeros(3)) for _, parent, child, place in fixed}
    parts = []
    for link in links:
        xx, yy, zz = link["moments"]
        shape = {"none": "", "box": f'<box><size>{_numbers(link["size"])}</size></box>',
                 "cylinder": "<cylinder><radius>0.05</radius><length>0.2</length></cylinder>",
                 "sphere": "<sphere><radius>0.1</radius></sphere>",
                 "mesh": f"<mesh><uri>{link['mesh'].format(robot=name)}</uri></mesh>"
                 }[link["shape"]]
        parent, place, rpy = places.get(link["name"], ("", np.zeros(3), np.zeros(3)))
        above = f'<pose relative_to="{parent}">{_numbers(place)} {_numbers(rpy)}</pose>'
        parts.append(
            f'<link name="{link["name"]}">{above if parent else ""}<inertial><pose>'
            f'{_numbers(link["com"])} 0 0 0</pose><mass>{link["mass"]:.9g}</mass><inertia><ixx>'
            f'{xx:.9g}</ixx><iyy>{yy:.9g}</iyy><izz>{zz:.9g}</izz></inertia></inertial>'
            + (f'<visual name="v"><geometry>{shape}</geometry></visual>' if shape else "")
            + ('<collision name="c"><geometry><mesh><uri>no.stl</uri></mesh></geometry></collision>'
               if link["collides"] else "") + "</link>")
    for joint in joints:
        limits = "" if joint["limits"] is None else (
            "<lower>{:.9g}</lower><upper>{:.9g}</upper>".format(*joint["limits"]))
        parts.append(
            f'<joint name="{joint["name"]}" type="{joint["type"]}"><parent>{joint["parent"]}'
            f'</parent><child>{joint["child"]}</child><axis><xyz>{_numbers(joint["axis"])}</xyz>'
            f'<limit>{limits}<effort>150</effort></limit><dynamics><damping>'
            f'{joint["damping"]:.9g}</damping></dynamics></axis><drake:rotor_inertia>5e-5'
            '</drake:rotor_inertia><drake:gear_ratio>100</drake:gear_ratio></joint>')
    parts += [f'<joint name="{joint}" type="fixed"><parent>{parent}</parent><child>{child}</child>'
              "</joint>" for joint, parent, child, _ in fixed]
    rng.shuffle(parts)
    return (f'<sdf version="1.9" xmlns:drake="http://drake.mit.edu"><model name="{name}">'
            + "\n".join(parts) + f'<frame name="tip" attached_to="{last}"><pose>{_numbers(offset)} '
            "0 0 0</pose></frame></model></sdf>")
