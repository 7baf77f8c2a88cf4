"""Synthetic robots with arms of any number of joints, and their tasks; not tuned."""

from pathlib import Path

import numpy as np
import yaml

from uvms_drake.model.description.robot_files import model_dir

TEMPLATE = "box_uvms"
LENGTH = 0.6
"""Of the whole arm [m]; so are its mass and volume those of the template's arm."""
MASS, VOLUME = 3.0, 1.7e-3

LINK = """
    <link name="link{i}">
      <pose relative_to="{before}">{x} 0 {z} 0 0 0</pose>
      <inertial>
        <pose>{middle} 0 0 0 0 0</pose>
        <mass>{mass}</mass>
        <inertia> <ixx>{ixx}</ixx> <iyy>{iyy}</iyy> <izz>{iyy}</izz>
          <ixy>0</ixy> <ixz>0</ixz> <iyz>0</iyz> </inertia>
      </inertial>
    </link>
    <joint name="joint{i}" type="{kind}">
      <parent>{before}</parent> <child>link{i}</child>
      <axis>
        <xyz>{axis}</xyz>
        <limit> <lower>-2</lower> <upper>2</upper> <effort>30</effort> <velocity>0.5</velocity>
        </limit>
        <dynamics><damping>1.0</damping></dynamics>
      </axis>
      <drake:rotor_inertia>5e-5</drake:rotor_inertia> <drake:gear_ratio>100</drake:gear_ratio>
    </joint>
"""


def write_arm(folder: Path, n: int, *, telescope: bool = False) -> Path:
    """Returns the folder of a box with n equal links, whose joints pitch and yaw in turn.

    The last one of a telescope slides along itself instead.
    """
    robot, source = folder / f"arm{n}", model_dir(TEMPLATE)
    robot.mkdir(parents=True)
    text = (source / f"{TEMPLATE}.sdf").read_text(encoding="utf-8")
    size, mass = LENGTH / n, MASS / n
    place = text.split('<link name="upper_arm">')[1].split("<pose relative_to=\"vehicle\">")[1]
    x, _, z = place.split()[:3]
    links = [LINK.format(
        i=i, before="vehicle" if i == 1 else f"link{i - 1}", x=x if i == 1 else size,
        z=z if i == 1 else 0.0, middle=0.5 * size, mass=mass, ixx=mass * 0.03**2 / 2.0,
        iyy=mass * (size**2 / 12.0 + 0.03**2 / 4.0),
        kind="prismatic" if telescope and i == n else "revolute",
        axis="1 0 0" if telescope and i == n else "0 1 0" if i % 2 else "0 0 1")
        for i in range(1, n + 1)]
    head, tip = text.split('<link name="upper_arm">')[0], f"""
    <frame name="tip" attached_to="link{n}"> <pose>{size} 0 0 0 0 0</pose> </frame>
  </model>
</sdf>
"""
    head = head[: head.rindex("</link>") + len("</link>")].replace(TEMPLATE, robot.name)
    (robot / f"{robot.name}.sdf").write_text(head + "".join(links) + tip, encoding="utf-8")
    package = (source / "package.xml").read_text(encoding="utf-8")
    (robot / "package.xml").write_text(package.replace(TEMPLATE, robot.name), encoding="utf-8")
    water = yaml.safe_load((source / "hydrodynamics.yaml").read_text(encoding="utf-8"))
    across = 1000.0 * VOLUME / n
    water["bodies"] = {"vehicle": water["bodies"]["vehicle"]} | {f"link{i}": {
        "displaced_volume": VOLUME / n, "center_of_buoyancy": [0.5 * size, 0.0, 0.0],
        "added_mass": [{"matrix": [0.0, across, across, 0.0, *[across * size**2 / 12.0] * 2],
                        "point": [0.5 * size, 0.0, 0.0]}],
        "drag": [{"quadratic": [0.0, *[33.0 * size] * 2, 0.0, 0.0, 0.0],
                  "point": [0.5 * size, 0.0, 0.0]}]} for i in range(1, n + 1)}
    (robot / "hydrodynamics.yaml").write_text(yaml.safe_dump(water), encoding="utf-8")
    return robot


def write_press(folder: Path, n: int, *, telescope: bool = False) -> Path:
    """Returns the scenario file in which such a robot presses 10 N on a wall, the arm bent."""
    write_arm(folder, n, telescope=telescope)
    posture = np.zeros(n)
    posture[0], posture[2 * ((n - 1) // 2)] = -0.6, 0.6
    reach = LENGTH / n * (np.sum(np.cos(np.cumsum(posture[::2])).repeat(2)[:n]))
    drop = LENGTH / n * (np.sum(np.sin(np.cumsum(-posture[::2])).repeat(2)[:n]))

    def each(vehicle: list[float], joint: float) -> list[float]:
        return [*vehicle, *[joint] * n]

    data = {
        "base": "girona500_ideal", "description": f"A box with {n} joints presses 10 N on a wall.",
        "model": f"arm{n}", "duration": 8.0,
        "start": {"eta": [-0.42 - float(reach) - 0.1, -0.02, -0.12 - float(drop), 0.0, 0.0, 0.02],
                  "q": posture.tolist()},
        "task": {"force": [10.0, *[0.0] * 5], "posture": posture.tolist(), "force_tolerance": 1.0},
        "disturbance": {"_tag": "!SinusoidalDisturbance", "bound": 0.05,
                        "weights": each([1.0] * 3 + [2.0] * 3, 4.0)},
        "limits": {"nu1": 0.2, "nu2": 0.2, "qdot": 0.3, "roll": 0.2, "pitch": 0.2,
                   "static_force": 30.0, "q_lower": (posture - 0.25).tolist(),
                   "q_upper": (posture + 0.25).tolist(),
                   "u": each([0.8] * 3 + [2.0] * 3, 15.0)},
        "tube": {"u": each([0.1] * 3 + [0.2] * 3, 1.0)},
        "mpc": {"weight_y": each([20.0] * 3 + [10.0] * 3, 2.0),
                "weight_zeta": each([5.0] * 6, 10.0),
                "weight_u": each([2.0] * 3 + [0.3] * 3, 0.01)}}
    file = folder / f"press{n}.yaml"
    del data["disturbance"]["_tag"]  # The base's kind.
    file.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    return file
