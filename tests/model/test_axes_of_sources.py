"""Axes of added mass and drag by the source of a file: the same water comes out at the same place.

The robot is a box of 80 kg with its mass at the origin, and water of (60, 100, 140) kg that acts
0.2 m above it. By hand, in axes with z up: M_15 = 60 · 0.2, M_24 = −100 · 0.2; in FRD p = −0.2.
"""

from pathlib import Path

import numpy as np
import pytest
from support.pages import ROOT

import uvms_drake as uv
from uvms_drake.command.main import main
from uvms_drake.command.robot import write_robot
from uvms_drake.model.description.hydrodynamics_file import added_mass_about_origin
from uvms_drake.model.description.water_center import water_center
from uvms_drake.model.robot_import.importer import import_robot
from uvms_drake.plant.uvms_plant import make_uvms_plant, set_state

CASE = ROOT / "tests" / "field_cases" / "uuv_added_mass_axes" / "scout.urdf"
TRANSLATION, TURNING = np.array([60.0, 100.0, 140.0]), np.array([5.0, 4.6, 5.0])
TURN = np.diag([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
LETTERS, RATES = "xyzkmn", "UVWPQR"


def water_at(p: np.ndarray, frame: np.ndarray | None = None) -> np.ndarray:
    """Returns M_A (6, 6) about the origin of water that acts at p (3,), in axes of a frame (3, 3).

    By the kinetic energy ½ (v + ω × p)ᵀ A (v + ω × p) + ½ ωᵀ J ω, entry by entry.
    """
    R = np.eye(3) if frame is None else frame
    velocities = np.stack([np.concatenate([R.T @ (e[:3] + np.cross(e[3:], p)), R.T @ e[3:]])
                           for e in np.eye(6)], axis=1)
    return velocities.T @ np.diag(np.concatenate([TRANSLATION, TURNING])) @ velocities


FLU, FRD = water_at(np.array([0.0, 0.0, 0.2])), water_at(np.array([0.0, 0.0, -0.2]))
BOX = "<size>0.9 0.6 0.5</size>"


def numbers(values: np.ndarray) -> str:
    return " ".join(f"{value:.12g}" for value in np.ravel(values))


def uuv(M: np.ndarray, library: str = "libuuv_underwater_object_ros_plugin.so",
        link: str = "base_link", volume: float = 0.0786, center: str = "0 0 0.2",
        drag: str = "<linear_damping>-40 -50 -60 -20 -20 -20</linear_damping>") -> str:
    return f"""<plugin name="water" filename="{library}"><fluid_density>1025</fluid_density>
      <link name="{link}"><volume>{volume}</volume>
      <center_of_buoyancy>{center}</center_of_buoyancy><hydrodynamic_model><type>fossen</type>
      <added_mass>{numbers(M)}</added_mass>{drag}</hydrodynamic_model></link></plugin>"""


def gz(M: np.ndarray) -> str:
    entries = "".join(f"<{LETTERS[i]}Dot{RATES[j]}>{-M[i, j]:.12g}</{LETTERS[i]}Dot{RATES[j]}>"
                      for i in range(6) for j in range(6) if abs(M[i, j]) > 1e-12)
    return ('<plugin filename="gz-sim-hydrodynamics-system" name="gz::sim::systems::Hydrodynamics">'
            f"<link_name>base_link</link_name>{entries}<xU>-40</xU></plugin>")


def fluid(M: np.ndarray) -> str:
    keys = "xyzpqr"
    return "<fluid_added_mass>" + "".join(
        f"<{keys[i]}{keys[j]}>{M[i, j]:.12g}</{keys[i]}{keys[j]}>"
        for i in range(6) for j in range(i, 6)) + "</fluid_added_mass>"


def sdf(plugin: str = "", inertial: str = "", more: str = "") -> str:
    """Returns a box whose only collision shape, 0.2 m above the origin, displaces 0.0786 m³."""
    return f"""<sdf version="1.10"><model name="scout"><link name="base_link">
      <inertial><mass>80</mass><inertia><ixx>8</ixx><iyy>10</iyy><izz>11</izz><ixy>0</ixy>
      <ixz>0</ixz><iyz>0</iyz></inertia>{inertial}</inertial>
      <visual name="hull"><geometry><box>{BOX}</box></geometry></visual>
      <collision name="foam"><pose>0 0 0.2 0 0 0</pose><geometry><box><size>0.9 0.6 0.1455556</size>
      </box></geometry></collision></link>{more}{plugin}
      <plugin filename="gz-sim-buoyancy-system" name="gz::sim::systems::Buoyancy"/>
      <frame name="tool_tip" attached_to="base_link"><pose>0.6 0 0 0 0 0</pose></frame>
      </model></sdf>"""


def urdf(plugin: str, name: str = "base_link", more: str = "") -> str:
    return f"""<robot name="scout"><link name="{name}"><inertial><mass value="80"/>
      <inertia ixx="8" iyy="10" izz="11" ixy="0" ixz="0" iyz="0"/></inertial>
      <visual><geometry><box size="0.9 0.6 0.5"/></geometry></visual></link>
      <link name="tool_tip"/><joint name="tool_mount" type="fixed"><origin xyz="0.6 0 0"/>
      <parent link="{name}"/><child link="tool_tip"/></joint>{more}
      <gazebo>{plugin}</gazebo></robot>"""


FILES = {"uuv_simulator": ("urdf", urdf(uuv(FRD))),
         "dave": ("sdf", sdf(uuv(FRD, "libuuv_underwater_object_plugin.so"))),
         "plankton": ("urdf", urdf(uuv(FRD).replace('name="water"', 'name="uuv_plugin"'))),
         "gz-sim": ("sdf", sdf(gz(FLU))), "fluid_added_mass": ("sdf", sdf("", fluid(FLU)))}


def robot_of(source: str, folder: Path) -> uv.Robot:
    """Returns the robot out of a file of a source; of ours, a folder as it is."""
    kind, text = FILES["uuv_simulator" if source == "ours" else source]
    (folder / f"file.{kind}").write_text(text, encoding="utf-8")
    assert write_robot(folder / f"file.{kind}", folder / "scout") == 0
    if source == "ours":
        water = folder / "scout" / "hydrodynamics.yaml"
        water.write_text(f"""fluid_density: 1025.0
bodies:
  vehicle:
    displaced_volume: 0.0786
    center_of_buoyancy: [0.0, 0.0, -0.2]
    added_mass:
      - matrix: {np.round(FRD, 9).tolist()}
""", encoding="utf-8")
    return uv.Robot.load(folder / "scout")


@pytest.mark.parametrize("source", [*FILES, "ours"])
def test_water_above_comes_out_above_and_a_push_ahead_lifts_the_bow(source, tmp_path):
    """By the plant's acceleration: the push at the origin is below the water that it moves.

    (M_RB + M_A) δζ̇ = τ with M_RB of the box, solved by hand.
    """
    robot = robot_of(source, tmp_path)
    body = robot.uvms.hydrodynamics.bodies["vehicle"]
    M = added_mass_about_origin(body.added_mass)
    np.testing.assert_allclose(water_center(M), [0.0, 0.0, -0.2], atol=1e-9)
    np.testing.assert_allclose(body.center_of_buoyancy, [0.0, 0.0, -0.2], atol=1e-9)
    plant = make_uvms_plant(str(robot.folder), surface=None, disturbance=None)
    context = plant.CreateDefaultContext()
    set_state(plant, context, np.zeros(12))
    plant.GetInputPort("disturbance").FixValue(context, np.zeros(6))

    def acceleration(tau: np.ndarray) -> np.ndarray:
        plant.GetInputPort("tau").FixValue(context, tau)
        return plant.GetOutputPort("acceleration").Eval(context).copy()

    push = np.array([25.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    found = acceleration(push) - acceleration(np.zeros(6))
    # By hand: 140 u̇ − 12 q̇ = 25 and −12 u̇ + (10 + 4.6 + 60 · 0.2²) q̇ = 0.
    q_dot = 12.0 * 25.0 / (140.0 * (10.0 + 4.6 + 60.0 * 0.04) - 144.0)
    np.testing.assert_allclose(found, [(25.0 + 12.0 * q_dot) / 140.0, 0, 0, 0, q_dot, 0],
                               atol=1e-9)
    assert q_dot > 0.0  # The bow goes up: y points to starboard.


def test_buoyancy_of_uuv_simulator_is_seen_from_the_centre_of_mass(tmp_path):
    """5 cm above it, where the origin is 10 cm below: upright, as Gazebo has it."""
    (tmp_path / "file.sdf").write_text(
        sdf(uuv(FRD, center="0 0 0.05"), "<pose>0 0 0.1 0 0 0</pose>"), encoding="utf-8")
    assert write_robot(tmp_path / "file.sdf", tmp_path / "scout") == 0
    body = uv.Robot.load(tmp_path / "scout").uvms.hydrodynamics.bodies["vehicle"]
    np.testing.assert_allclose(body.center_of_buoyancy, [0.0, 0.0, -0.15], atol=1e-9)


@pytest.mark.parametrize("source", FILES)
def test_the_list_says_whose_axes_were_taken(source, tmp_path):
    kind, text = FILES[source]
    (tmp_path / f"file.{kind}").write_text(text, encoding="utf-8")
    notes = import_robot(tmp_path / f"file.{kind}", "scout").notes
    (line,) = [line for line in notes.taken if line.startswith("axes of matrices")]
    assert ("ToNED" in line) == (source in ("uuv_simulator", "dave", "plankton"))
    assert not any("added_mass" in line for line in notes.asked)


def test_the_scout_has_its_water_where_its_buoyancy_is(tmp_path, capsys):
    """The case as it was reported."""
    assert main(["robot", "--from", str(CASE), str(tmp_path / "scout")]) == 0
    capsys.readouterr()
    assert main(["robot", str(tmp_path / "scout")]) == 0
    assert "buoyancy at (0, 0, -0.2) m, added mass by its couplings at (0, 0, -0.2) m" in (
        capsys.readouterr().out)
    M = added_mass_about_origin(
        uv.Robot.load(tmp_path / "scout").uvms.hydrodynamics.bodies["vehicle"].added_mass)
    assert (M[0, 4], M[1, 3]) == (-12.0, 20.0)


def lines_of(text: str, folder: Path, name: str = "file.urdf") -> tuple[np.ndarray, list[str]]:
    """Returns the vehicle's added mass out of a file, and the lines that ask."""
    (folder / name).write_text(text, encoding="utf-8")
    asked = import_robot(folder / name, "scout").notes.asked
    assert write_robot(folder / name, folder / "scout") == 0
    robot = uv.Robot.load(folder / "scout")
    return added_mass_about_origin(robot.uvms.hydrodynamics.bodies["vehicle"].added_mass), asked


def test_a_matrix_that_was_written_with_z_up_is_asked_about(tmp_path):
    """The simulator takes it for FRD, whatever its author meant: the water is below then."""
    M, asked = lines_of(urdf(uuv(FLU)), tmp_path)
    np.testing.assert_allclose(water_center(M), [0.0, 0.0, 0.2], atol=1e-9)
    (line,) = [line for line in asked if "bodies.vehicle.added_mass" in line]
    assert "buoyancy at (0, 0, -0.2) m, added mass by its couplings at (0, 0, 0.2) m" in line
    assert "turned by diag(1, -1, -1) it is at (0, 0, -0.2) m" in line


def test_a_link_that_is_frd_has_its_matrix_turned_by_the_simulator_and_is_asked_about(tmp_path):
    """Its z is down, and `ToNED` changes the signs of y and z all the same."""
    text = urdf(uuv(FRD, link="base_link_frd", center="0 0 -0.2"), "base_link_frd")
    M, asked = lines_of(text, tmp_path)
    np.testing.assert_allclose(M, FLU, atol=1e-9)
    assert any("turned by diag(1, -1, -1) it is at (0, 0, -0.2) m" in line for line in asked)


@pytest.mark.parametrize(("scale", "said"), [(1e3, "times the displaced water"), (1.0, None)])
def test_an_added_mass_in_grams_is_asked_about(scale, said, tmp_path):
    _, asked = lines_of(urdf(uuv(scale * FRD)), tmp_path)
    assert any(said in line for line in asked) if said else not any(
        "added_mass" in line for line in asked)


def test_couplings_that_act_meters_away_are_asked_about(tmp_path):
    """In millimetres: 200 m above."""
    M = FRD.copy()
    M[:3, 3:] *= 10.0
    M[3:, :3] *= 10.0
    M[3:, 3:] *= 100.0
    _, asked = lines_of(urdf(uuv(M)), tmp_path)
    (line,) = [line for line in asked if "added_mass" in line]
    assert "couplings at (0, 0, -2) m" in line and "other axes or units" in line


@pytest.mark.parametrize("roll", [np.pi, 0.5 * np.pi, 0.3])
def test_water_of_a_link_that_is_turned_is_frd_of_that_link(roll, tmp_path):
    """As of the link for NED axes in old templates: the force is of diag(1, −1, −1) of its own."""
    R = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(roll), -np.sin(roll)],
                  [0.0, np.sin(roll), np.cos(roll)]])
    foam = f"""<link name="foam"><inertial><mass value="0.001"/><inertia ixx="1e-6" iyy="1e-6"
      izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="on" type="fixed">
      <origin xyz="0 0 0" rpy="{roll!r} 0 0"/><parent link="base_link"/><child link="foam"/>
      </joint>"""
    up = R.T @ [0.0, 0.0, 0.2]  # The centre of buoyancy in the foam's axes.
    M, _ = lines_of(urdf(uuv(FRD, link="foam", center=numbers(up)), more=foam), tmp_path)
    # Of the foam z down, and from there to the vehicle's FRD.
    frame = np.diag([1.0, -1.0, -1.0]) @ R @ np.diag([1.0, -1.0, -1.0])
    T = np.kron(np.eye(2), frame)
    np.testing.assert_allclose(M, T @ FRD @ T.T, atol=1e-8)


def test_drag_of_a_full_matrix_is_its_diagonal_and_the_rest_is_told(tmp_path):
    D = -np.diag([40.0, 50.0, 60.0, 20.0, 21.0, 22.0])
    D[0, 4] = D[4, 0] = 3.0
    text = urdf(uuv(FRD, drag=f"<linear_damping>{numbers(D)}</linear_damping>"))
    (tmp_path / "file.urdf").write_text(text, encoding="utf-8")
    found = import_robot(tmp_path / "file.urdf", "scout")
    assert any("2 entries of linear drag off the diagonal left out, the largest 3" in line
               for line in found.notes.changed)
    assert "linear: [40, 50, 60, 20, 21, 22]" in found.files["hydrodynamics.yaml"].decode()


def test_the_published_water_of_rexrov_is_where_its_buoyancy_is(tmp_path):
    """Upper blocks as published: 0.21 m above by surge and pitch, 0.33 m by sway and roll."""
    M = np.array([[779.79, -6.8773, -103.32, 8.5426, -165.54, -7.8033],
                  [-6.8773, 1222, 51.29, 409.44, -5.8488, 62.726],
                  [-103.32, 51.29, 3659.9, 6.1112, -386.42, 10.775],
                  [8.5426, 409.44, 6.1112, 534.9, -10.027, 21.019],
                  [-165.54, -5.8488, -386.42, -10.027, 842.69, -1.1162],
                  [-7.8033, 62.726, 10.775, 21.019, -1.1162, 224.32]])
    text = urdf(uuv(M, volume=1.838, center="0 0 0.3")).replace('"80"', '"1863"').replace(
        'ixx="8" iyy="10" izz="11"', 'ixx="525.39" iyy="794.2" izz="691.23"')
    found, asked = lines_of(text, tmp_path)
    np.testing.assert_allclose(found, M, atol=1e-7)
    assert -0.34 < water_center(found)[2] < -0.2
    assert not any("added_mass" in line for line in asked)
    # With its couplings turned it would be asked about.
    folder = tmp_path / "turned"
    folder.mkdir()
    _, asked = lines_of(text.replace(numbers(M), numbers(TURN @ M @ TURN)), folder)
    assert any("turned by diag(1, -1, -1)" in line for line in asked)


def test_a_scaling_that_the_simulator_does_not_read_is_told_and_not_applied(tmp_path):
    """`HMFossen` sets it to 1, and changes it by a service alone."""
    text = urdf(uuv(FRD)).replace("<type>", "<scaling_added_mass>2</scaling_added_mass><type>")
    M, _ = lines_of(text, tmp_path)
    np.testing.assert_allclose(M, FRD, atol=1e-9)
    changed = import_robot(tmp_path / "file.urdf", "scout").notes.changed
    assert any("scaling_added_mass = 2" in line for line in changed)
