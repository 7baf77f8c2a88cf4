"""The examples of a loop of one's own: each does what its first lines say."""

import importlib.util
import socket
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from pydrake.math import RollPitchYaw
from support.pages import ROOT

import uvms_drake as uv
from uvms_drake.loop.command import Mode

FOLDER = ROOT / "examples/your_loop"


def example(name: str):
    """Returns an example as a module."""
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def rest(scenario: uv.Scenario) -> np.ndarray:
    return np.append(scenario.start.config, np.zeros(len(scenario.start.config)))


def test_the_plain_loop_is_short_and_runs(monkeypatch, capsys):
    lines = (FOLDER / "plain_loop.py").read_text().split("def main")[1].splitlines()
    assert len(lines) <= 45
    monkeypatch.setattr(sys, "argv", ["plain_loop.py", "--duration=0.3"])
    example("plain_loop").main()
    assert "force at the end: 0.00 N" in capsys.readouterr().out


@pytest.mark.long
def test_the_plain_loop_presses_with_the_desired_force(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["plain_loop.py", "--duration=14"])
    example("plain_loop").main()
    *alarms, last = capsys.readouterr().out.splitlines()
    assert float(last.split()[4]) == pytest.approx(20.0, abs=2.0)
    assert alarms == []


# ROS 2: messages with the fields of the standard ones, without ROS.


def odometry(state: np.ndarray):
    """Returns an Odometry of (𝔮, ζ), in ENU and FLU by Drake's transforms."""
    x, y, z = state[:3]
    R = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]]) @ RollPitchYaw(
        state[3:6]).ToRotationMatrix().matrix() @ np.diag([1.0, -1, -1])
    from pydrake.math import RotationMatrix
    q = RotationMatrix(R).ToQuaternion()
    v, w = state[10:13] * [1, -1, -1], state[13:16] * [1, -1, -1]
    def vector(a):
        return SimpleNamespace(x=a[0], y=a[1], z=a[2])
    return SimpleNamespace(
        pose=SimpleNamespace(pose=SimpleNamespace(
            position=vector([y, x, -z]),
            orientation=SimpleNamespace(x=q.x(), y=q.y(), z=q.z(), w=q.w()))),
        twist=SimpleNamespace(twist=SimpleNamespace(linear=vector(v), angular=vector(w))))


@pytest.fixture(scope="module")
def controller():
    return uv.Controller(uv.load_scenario("girona500_contact"), period=0.01)


def test_the_node_starts_with_its_messages_and_tells_when_they_stop(controller):
    node = example("ros2_node")
    joints = ["shoulder", "elbow", "wrist", "slew"]
    logic, state = node.Logic(controller, joints), rest(controller.scenario)
    state[10:] = 1e-3 * np.arange(10)
    assert logic.tick(0.0) is None  # Nothing has come yet.

    def send(now: float) -> None:
        order = [2, 0, 3, 1]  # Another order than the model's.
        logic.receive("odometry", now, odometry(state))
        logic.receive("joint_states", now, SimpleNamespace(
            name=[joints[i] for i in order], position=state[6:10][order].tolist(),
            velocity=state[16:][order].tolist()))
        logic.receive("wrench", now, SimpleNamespace(wrench=SimpleNamespace(
            force=SimpleNamespace(x=0.0, y=0.0, z=0.0),
            torque=SimpleNamespace(x=0.0, y=0.0, z=0.0))))

    send(100.0)
    np.testing.assert_allclose(logic._state(100.0), state, atol=1e-12)
    assert logic.tick(100.0) is None  # It has made the first plan.
    send(103.0)
    assert logic.tick(103.0).mode == Mode.RUNNING
    silent = [logic.tick(103.0 + 0.01 * k) for k in range(1, 80)]
    assert "the state is missing" not in silent[5].alarms
    assert "the state is missing" in silent[15].alarms
    assert silent[-1].mode == Mode.STOPPED


class Fields:
    """Message with the fields of its class alone, each of its type, as rclpy's are."""

    fields: dict = {}  # noqa: RUF012  of each kind

    def __init__(self, **given):
        for name, kind in self.fields.items():
            object.__setattr__(self, name, kind())
        for name, value in given.items():
            setattr(self, name, value)

    def __setattr__(self, name, value):
        kind = self.fields[name]  # KeyError: the message has no such field.
        assert isinstance(value, kind), (name, value)
        if kind is list:
            assert all(type(each) in (float, str) for each in value), (name, value)
        object.__setattr__(self, name, value)


def kind(name: str, /, **fields) -> type:
    return type(name, (Fields,), {"fields": fields})


TIME = kind("Time", sec=int, nanosec=int)
HEADER = kind("Header", stamp=TIME, frame_id=str)
XYZ = kind("Vector3", x=float, y=float, z=float)
XYZW = kind("Quaternion", x=float, y=float, z=float, w=float)
WRENCH, TWIST = kind("Wrench", force=XYZ, torque=XYZ), kind("Twist", linear=XYZ, angular=XYZ)
MESSAGES = {
    "geometry_msgs": {"WrenchStamped": kind("WrenchStamped", header=HEADER, wrench=WRENCH)},
    "nav_msgs": {"Odometry": kind(
        "Odometry", header=HEADER, child_frame_id=str,
        pose=kind("PoseWithCovariance", pose=kind("Pose", position=XYZ, orientation=XYZW)),
        twist=kind("TwistWithCovariance", twist=TWIST))},
    "sensor_msgs": {"JointState": kind(
        "JointState", header=HEADER, name=list, position=list, velocity=list, effort=list)},
    "std_msgs": {"Float64MultiArray": kind("Float64MultiArray", data=list),
                 "String": kind("String", data=str)}}


def test_the_node_subscribes_publishes_and_ticks(controller, monkeypatch):
    """With a minimal rclpy, whose spin sends half a second of messages and calls the timer."""
    joints, state = ["slew", "shoulder", "elbow", "jaw"], rest(controller.scenario)
    seen = {"subscribed": {}, "published": {}, "down": False}

    class Node:
        """Node with a clock that spin sets."""

        now = 50.0

        def __init__(self, name):
            seen["node"] = self

        def get_clock(self):
            nanoseconds = round(1e9 * self.now)
            stamp = TIME(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
            return SimpleNamespace(now=lambda: SimpleNamespace(
                nanoseconds=nanoseconds, to_msg=lambda: stamp))

        def create_subscription(self, kind, topic, callback, depth):
            assert kind in [each for of in MESSAGES.values() for each in of.values()]
            seen["subscribed"][topic] = kind, callback

        def create_publisher(self, kind, topic, depth):
            sent = seen["published"][topic] = []

            def publish(message):
                assert type(message) is kind
                sent.append(message)

            return SimpleNamespace(publish=publish)

        def create_timer(self, period, callback):
            seen["timer"] = period, callback

    def spin(node):
        period, tick = seen["timer"]
        for k in range(50):
            node.now = 50.0 + k * period
            if k < 35:  # Then they stop.
                for topic, (kind, callback) in seen["subscribed"].items():
                    message = kind()
                    if topic == "odometry":
                        message = odometry(state)
                    elif topic == "joint_states":
                        message.name, message.position = joints, state[6:10].tolist()
                        message.velocity = state[16:].tolist()
                    callback(message)
            tick()

    rclpy, node_module = ModuleType("rclpy"), ModuleType("rclpy.node")
    rclpy.init, rclpy.spin, node_module.Node = lambda: None, spin, Node
    rclpy.shutdown = lambda: seen.update(down=True)
    modules = {"rclpy": rclpy, "rclpy.node": node_module}
    for package, kinds in MESSAGES.items():
        modules[package], modules[f"{package}.msg"] = (ModuleType(package), ModuleType("msg"))
        vars(modules[f"{package}.msg"]).update(kinds)
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    node = example("ros2_node")
    monkeypatch.setattr(sys, "argv", ["ros2_node.py", "girona500_contact", ",".join(joints)])
    monkeypatch.setattr(node.uv, "Controller", lambda scenario, wait: controller)
    commands, step = [], controller.step
    monkeypatch.setattr(controller, "step",
                        lambda *samples: commands.append(step(*samples)) or commands[-1])
    node.main()

    sent = seen["published"]
    assert seen["timer"][0] == controller.period and seen["down"]
    assert set(seen["subscribed"]) == {"odometry", "joint_states", "wrench"}
    # The first tick makes the first plan; each later one sends a command with its stamp.
    assert [len(sent[name]) for name in ("vehicle_wrench", "thrusters", "joint_commands")] == [
        49, 49, 49]
    first, last = sent["vehicle_wrench"][0], sent["vehicle_wrench"][-1]
    assert (first.header.stamp.sec, first.header.stamp.nanosec) == (50, 10_000_000)
    assert last.header.stamp.nanosec == 490_000_000
    for command, wrench, arm, thrusters in zip(commands, *(sent[name] for name in (
            "vehicle_wrench", "joint_commands", "thrusters")), strict=True):
        for part, axes in ((wrench.wrench.force, command.tau[:3]),
                           (wrench.wrench.torque, command.tau[3:6])):
            assert [part.x, -part.y, -part.z] == axes.tolist()  # FLU of FRD.
        assert arm.name == joints and arm.effort == command.joints.torque.tolist()
        assert arm.velocity == command.joints.velocity.tolist()
        assert arm.position == command.joints.position.tolist()
        assert thrusters.data == command.thruster_commands.tolist()
    said = [message.data for message in sent["alarms"]]
    assert said and all(": " in text for text in said)
    assert "the state is missing" in said[-1] and "the state is missing" not in said[0]


# Replay.


def test_a_replay_of_a_loops_log_gives_its_commands_again(controller, tmp_path):
    replay, rng = example("replay"), np.random.default_rng(0)
    state, time = rest(controller.scenario), 5.0 + 0.01 * np.arange(12)
    states = state + 1e-4 * rng.standard_normal((12, 20))
    states[0], forces = state, 0.02 * rng.standard_normal((12, 6))
    controller.reset(states[0])
    sent = [controller.step(*row).tau for row in zip(time, states, forces, strict=True)]
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack([time, states, forces]), delimiter=",", header="t,...",
               fmt="%.17g")
    again = replay.replayed(controller, *replay.read_log(path, 10))
    np.testing.assert_array_equal([command.tau for command in again], sent)


# MAVLink, by pymavlink's own link on the loopback.


@pytest.fixture
def link():
    mavutil = pytest.importorskip("pymavlink.mavutil", reason="needs the extra mavlink")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    autopilot = example("autopilot").Autopilot(f"udpin:127.0.0.1:{port}")
    vehicle = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}", source_system=1)
    yield autopilot, vehicle, port
    autopilot.link.close()
    vehicle.close()


def receive_until(autopilot, count: int) -> None:
    for _ in range(1000):
        autopilot.receive()
        if len(autopilot._last) >= count:
            return


def test_state_and_pwm_pass_the_link_and_an_old_state_is_none(link):
    autopilot, vehicle, _ = link
    now = [0.0]
    autopilot._clock = lambda: now[0]
    assert autopilot.state(np.zeros(4), np.zeros(4)) is None
    vehicle.mav.attitude_send(0, 0.1, -0.2, 0.5, 0.01, 0.02, 0.03)
    vehicle.mav.local_position_ned_send(0, 1.0, -2.0, 3.0, 0.1, 0.2, -0.3)
    receive_until(autopilot, 2)
    joints, rates = np.array([0.1, 0.2, 0.3, 0.4]), np.array([0.0, 0.1, 0.0, -0.1])
    state = autopilot.state(joints, rates)
    R = RollPitchYaw(0.1, -0.2, 0.5).ToRotationMatrix()
    expected = [1.0, -2.0, 3.0, 0.1, -0.2, 0.5, *joints,
                *(R.inverse() @ np.array([0.1, 0.2, -0.3])), 0.01, 0.02, 0.03, *rates]
    np.testing.assert_allclose(state, expected, atol=1e-6)
    now[0] = 0.2
    assert autopilot.state(joints, rates) is None
    # Commands to the vehicle: six thrusters, the other channels left alone; then all released.
    for pwm, channels in ((np.array([1500.4, 1100, 1900, 1499.6, 1600, 1400]),
                           [1500, 1100, 1900, 1500, 1600, 1400, 65535, 65535]), (None, [0] * 8)):
        autopilot.send(pwm)
        message = vehicle.recv_match(type="RC_CHANNELS_OVERRIDE", blocking=True, timeout=5)
        assert [getattr(message, f"chan{i + 1}_raw") for i in range(8)] == channels
    autopilot.beat()
    assert vehicle.recv_match(type="HEARTBEAT", blocking=True, timeout=5) is not None


def test_it_listens_at_the_address_asked_for_and_nowhere_else(link):
    autopilot, _, port = link
    assert autopilot.link.port.getsockname() == ("127.0.0.1", port)


# MuJoCo.


def test_mujoco_has_the_mass_matrix_and_the_acceleration_of_the_model():
    pytest.importorskip("mujoco", reason="needs the extra mujoco")
    in_mujoco = example("in_mujoco")
    for name in in_mujoco.SCENARIOS.values():
        scenario = uv.load_scenario(name)
        model = uv.load_model(scenario)
        robot = in_mujoco.MujocoRobot(scenario, 700.0, np.array([5.0, 0.0, 0.0]))
        rng = np.random.default_rng(1)
        robot.data.qvel[:] = 0.1 * rng.standard_normal(10)
        robot.tau = rng.standard_normal(10) * [20, 20, 20, 2, 2, 2, 0.1, 0.1, 0.1, 0.1]
        robot.step()  # From here on it has the rate of its Jacobians.
        before = robot.state()
        robot.step()
        rate = (robot.state() - before)[10:] / in_mujoco.STEP
        config, zeta = np.split(before, 2)
        M = model.mass_matrix(model.kinematics(config))
        expected = model.drift(config, zeta, np.zeros(6)) + np.linalg.solve(M, robot.tau)
        # In a force, where a light wrist does not count more than the vehicle: 1 g of the sensor.
        np.testing.assert_allclose(M @ rate, M @ expected, atol=0.05 * np.abs(robot.tau).max())


def test_the_wall_in_mujoco_has_the_stiffness_asked_for():
    """By its solver's own numbers: a contact at rest has the force aref / R."""
    pytest.importorskip("mujoco", reason="needs the extra mujoco")
    scenario = uv.load_scenario("girona500_contact")
    model, wall = uv.load_model(scenario), np.asarray(scenario.surface.geometry.point)
    robot = example("in_mujoco").MujocoRobot(scenario, 900.0, wall)
    tip = model.task_pose(robot.state()[:10])[:3]
    robot.data.qpos[0] += (-robot.normal @ (wall - tip) + 0.01) / -robot.normal[0]
    robot.step()
    assert robot.data.efc_aref[0] / robot.data.efc_R[0] == pytest.approx(9.0, rel=1e-3)


@pytest.mark.long
def test_a_short_press_in_mujoco_keeps_its_energy_and_its_sensors_agree():
    pytest.importorskip("mujoco", reason="needs the extra mujoco")
    run = example("in_mujoco").press("girona500_arm5e", 12.0)
    late = run["time"] > 10.0
    assert np.mean(run["force"][late]) == pytest.approx(20.0, abs=2.0)
    np.testing.assert_allclose(run["sensed"], run["force"], atol=0.5)
    change = run["energy"] - run["energy"][0]
    assert np.max(np.abs(change - run["work"])) < 0.01 * run["traffic"][-1]
