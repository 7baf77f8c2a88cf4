"""MAVLink: the state from an autopilot, and PWM of the thrusters to it.

ATTITUDE and LOCAL_POSITION_NED give the vehicle's state; RC_CHANNELS_OVERRIDE has the PWM of
thruster i on channel i, for an ArduSub whose SERVOi_FUNCTION passes RC channel i on (51, 52, ...).
The arm and its force sensor are not of MAVLink: `angles` below is where they come in.

    python examples/your_loop/autopilot.py bluerov2_real_loop udpin:127.0.0.1:14550
"""

import argparse
import time

import numpy as np
from pymavlink import mavutil

import uvms_drake as uv
from uvms_drake.sensing.conventions import Conventions

OLDEST = 0.1  # s, age of a message that is not used any more
RELEASE = 0  # PWM of a channel that is given back to the pilot
CONVENTIONS = Conventions("NED", "FRD", "rpy", velocity="world")  # Those of MAVLink.


class Autopilot:
    """Link to an autopilot.

    Args:
        address: Of pymavlink, such as `udpin:127.0.0.1:14550`, which listens there and nowhere
            else, or a serial device.
        clock: Clock of the ages [s].
    """

    def __init__(self, address: str, clock=time.monotonic):
        self.link, self._clock = mavutil.mavlink_connection(address, source_system=255), clock
        self._last: dict[str, tuple[float, object]] = {}

    def receive(self) -> None:
        """Takes all messages that have come."""
        while (message := self.link.recv_match(blocking=False)) is not None:
            self._last[message.get_type()] = self._clock(), message

    def state(self, joints: np.ndarray, joint_rates: np.ndarray) -> np.ndarray | None:
        """Returns (𝔮, ζ) with the arm's angles and rates; None if the vehicle's is old."""
        found = {}
        for kind in ("ATTITUDE", "LOCAL_POSITION_NED"):
            stamp, found[kind] = self._last.get(kind, (-np.inf, None))
            if self._clock() - stamp > OLDEST:
                return None
        a, p = found["ATTITUDE"], found["LOCAL_POSITION_NED"]
        return CONVENTIONS.state(
            np.array([p.x, p.y, p.z]), np.array([a.roll, a.pitch, a.yaw]), joints,
            np.array([p.vx, p.vy, p.vz]), np.array([a.rollspeed, a.pitchspeed, a.yawspeed]),
            joint_rates)

    def ask_for(self, period: float) -> None:
        """Asks for the messages of the state, one a period [s]: by default they come too seldom."""
        link, mav = self.link, mavutil.mavlink
        for message in (mav.MAVLINK_MSG_ID_ATTITUDE, mav.MAVLINK_MSG_ID_LOCAL_POSITION_NED):
            link.mav.command_long_send(
                link.target_system or 1, link.target_component or 1,
                mav.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message, 1e6 * period, 0, 0, 0, 0, 0)

    def send(self, pwm: np.ndarray | None) -> None:
        """Sends pulse widths [µs], of at most 8 thrusters; None releases all channels."""
        channels = np.full(8, RELEASE if pwm is None else 65535)  # 65535: left alone.
        if pwm is not None:
            channels[: len(pwm)] = np.rint(pwm)
        target = self.link.target_system or 1, self.link.target_component or 1
        self.link.mav.rc_channels_override_send(*target, *channels.tolist())

    def beat(self) -> None:
        """Sends a heartbeat, which an autopilot wants every second."""
        self.link.mav.heartbeat_send(mavutil.mavlink.MAV_TYPE_GCS,
                                     mavutil.mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)


def angles(scenario: uv.Scenario) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns angles, rates and force of the arm: replace it by your arm's driver."""
    return np.asarray(scenario.start.q), np.zeros(len(scenario.start.q)), np.zeros(6)


def main() -> None:
    """Runs the loop at its period."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario")
    parser.add_argument("address")
    arguments = parser.parse_args()
    scenario = uv.load_scenario(
        arguments.scenario, ["mpc.in_advance=true", "contact.period=0.02"])
    controller, autopilot = uv.Controller(scenario, wait=0.002), Autopilot(arguments.address)
    began, tick, last_beat = False, 0, -np.inf
    start = time.monotonic()
    try:
        while True:
            now = time.monotonic() - start
            autopilot.receive()
            q, rates, force = angles(scenario)
            state = autopilot.state(q, rates)
            if now - last_beat >= 1.0:
                autopilot.beat()
                if not began:
                    autopilot.ask_for(controller.period)
                last_beat = now
            if began:
                autopilot.send(controller.step(now, state, force).thruster_commands)
            elif state is not None:
                controller.reset(state)
                began, tick = True, round((time.monotonic() - start) / controller.period)
            tick += 1
            time.sleep(max(tick * controller.period - (time.monotonic() - start), 0.0))
    finally:
        autopilot.send(None)


if __name__ == "__main__":
    main()
