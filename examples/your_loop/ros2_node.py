"""A ROS 2 node with standard messages; its `Logic` needs no ROS, and is tested without it.

    subscribes  odometry (nav_msgs/Odometry), joint_states (sensor_msgs/JointState),
                wrench (geometry_msgs/WrenchStamped: tared, in the axes of the wrist sensor)
    publishes   vehicle_wrench (geometry_msgs/WrenchStamped), alarms (std_msgs/String),
                thrusters (std_msgs/Float64MultiArray), joint_commands (sensor_msgs/JointState)

    python examples/your_loop/ros2_node.py SCENARIO JOINT1,JOINT2,... [signals.yaml]

By REP 103 the world is ENU and the body FLU, see `signals.yaml`; stamps are of the timer's clock.
"""

import sys
from typing import Any

import numpy as np

import uvms_drake as uv
from uvms_drake.loop.command import LoopCommand
from uvms_drake.sensing.conventions import Conventions, load_conventions

REP103 = Conventions(world="ENU", body="FLU", attitude="xyzw", force="on_sensor")
OLDEST = 0.1  # s, age of a message that is not used any more


def xyz(of: Any) -> np.ndarray:
    """Returns x, y, z of a message."""
    return np.array([of.x, of.y, of.z])


class Logic:
    """Messages in, commands out; the node below only carries them.

    Args:
        controller: The controller.
        joints: Names of the arm's joints, in the order of the model.
        conventions: Axes of the messages.
    """

    def __init__(self, controller: uv.Controller, joints: list[str],
                 conventions: Conventions = REP103):
        self.controller, self.joints, self.conventions = controller, joints, conventions
        self._last: dict[str, tuple[float, Any]] = {}
        self._is_reset = False

    def receive(self, name: str, now: float, message: Any) -> None:
        """Keeps the last message of a topic."""
        self._last[name] = now, message

    def tick(self, now: float) -> LoopCommand | None:
        """Returns the command of a tick; None before there is a state to start from."""
        state = self._state(now)
        force = None if state is None else self._force(now, state)
        if not self._is_reset:
            if state is None:
                return None
            self.controller.reset(state)  # It takes seconds: the clock starts at the next tick.
            self._is_reset = True
            return None
        return self.controller.step(now, state, force)

    def _fresh(self, name: str, now: float) -> Any:
        stamp, message = self._last.get(name, (-np.inf, None))
        return message if now - stamp <= OLDEST else None

    def _state(self, now: float) -> np.ndarray | None:
        odometry, arm = self._fresh("odometry", now), self._fresh("joint_states", now)
        if odometry is None or arm is None or not set(self.joints) <= set(arm.name):
            return None
        if not len(arm.name) == len(arm.position) == len(arm.velocity):
            return None  # ROS allows a driver to leave velocities out; the law needs them.
        order = [list(arm.name).index(name) for name in self.joints]
        pose, twist = odometry.pose.pose, odometry.twist.twist
        q = pose.orientation
        return self.conventions.state(
            xyz(pose.position), np.array([q.x, q.y, q.z, q.w]), np.asarray(arm.position)[order],
            xyz(twist.linear), xyz(twist.angular), np.asarray(arm.velocity)[order])

    def _force(self, now: float, state: np.ndarray) -> np.ndarray | None:
        message = self._fresh("wrench", now)
        if message is None:
            return None
        wrench = np.concatenate([xyz(message.wrench.force), xyz(message.wrench.torque)])
        return self.conventions.contact_force(self.controller.model, state, wrench)


def main() -> None:
    """Runs the node."""
    import rclpy
    from geometry_msgs.msg import WrenchStamped
    from nav_msgs.msg import Odometry
    from rclpy.node import Node
    from sensor_msgs.msg import JointState
    from std_msgs.msg import Float64MultiArray, String

    scenario, joints = uv.load_scenario(sys.argv[1], ["mpc.in_advance=true"]), sys.argv[2]
    conventions = load_conventions(sys.argv[3]) if len(sys.argv) > 3 else REP103
    logic = Logic(uv.Controller(scenario, wait=0.002), joints.split(","), conventions)
    rclpy.init()
    node = Node("uvms_drake")

    def seconds() -> float:
        return node.get_clock().now().nanoseconds * 1e-9

    for name, kind in (("odometry", Odometry), ("joint_states", JointState),
                       ("wrench", WrenchStamped)):
        node.create_subscription(
            kind, name, lambda message, name=name: logic.receive(name, seconds(), message), 1)
    out = {name: node.create_publisher(kind, name, 1) for name, kind in (
        ("vehicle_wrench", WrenchStamped), ("thrusters", Float64MultiArray),
        ("joint_commands", JointState), ("alarms", String))}

    def tick() -> None:
        command = logic.tick(seconds())
        if command is None:
            return
        wrench, arm = WrenchStamped(), JointState()
        stamp = node.get_clock().now().to_msg()
        wrench.header.stamp = arm.header.stamp = stamp
        f = conventions.wrench(command.tau).tolist()
        wrench.wrench.force.x, wrench.wrench.force.y, wrench.wrench.force.z = f[:3]
        wrench.wrench.torque.x, wrench.wrench.torque.y, wrench.wrench.torque.z = f[3:]
        arm.name = logic.joints
        signs, joints = conventions.joint_signs, command.joints
        arm.effort, arm.velocity = (signs * joints.torque).tolist(), (
            signs * joints.velocity).tolist()
        arm.position = (signs * (joints.position - conventions.joint_offsets)).tolist()
        out["vehicle_wrench"].publish(wrench)
        out["joint_commands"].publish(arm)
        if command.thruster_commands is not None:
            out["thrusters"].publish(Float64MultiArray(data=command.thruster_commands.tolist()))
        if command.alarms:
            out["alarms"].publish(String(data=f"{command.mode}: {'; '.join(command.alarms)}"))

    node.create_timer(logic.controller.period, tick)
    with logic.controller:  # Which ends the process of its planner.
        rclpy.spin(node)
    rclpy.shutdown()


if __name__ == "__main__":
    main()
