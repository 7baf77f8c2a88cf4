"""Tests of `uvms_drake.identification.recordings`: logs of ArduSub and ROS 2, read back."""

import struct
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.common.schema import load_typed, parse_yaml
from uvms_drake.identification.readers import digest, read_log, read_tables
from uvms_drake.identification.recordings import is_recording
from uvms_drake.identification.signals_file import LogSignals

T = 1.7e9 + np.arange(0.0, 2.0, 0.02)
RPY = np.column_stack([0.2 * np.sin(3.0 * T), 0.1 * np.cos(T), np.unwrap(0.1 * (T - T[0]))])
GYRO = np.column_stack([np.cos(T), np.sin(2.0 * T), 0.3 * np.ones(len(T))])
Q = np.column_stack([np.sin(T + i) for i in range(4)])


def declared(text: str) -> LogSignals:
    return load_typed(LogSignals, parse_yaml(text))


def compared(path: Path, signals: LogSignals, **exact):
    """Compares the signals of a recording with those that were written, to 1e-6."""
    found = read_tables(path, signals)
    assert set(found) == set(exact)
    for name, values in exact.items():
        time, x = found[name]
        np.testing.assert_allclose(time - time[0], T - T[0], atol=1e-6)
        np.testing.assert_allclose(x, values, atol=1e-6)


# ROS 2.


ROS_SIGNALS = """
attitude: xyzw
world: ENU
body: FLU
signals:
  - {signal: attitude, file: /imu, time: header.stamp,
     columns: [orientation.x, orientation.y, orientation.z, orientation.w]}
  - {signal: angular_velocity, file: /imu, time: header.stamp,
     columns: [angular_velocity.x, angular_velocity.y, angular_velocity.z]}
  - {signal: joints, file: /joint_states,
     columns: ["position[0]", "position[1]", "position[2]", "position[3]"]}
"""
WXYZ = np.column_stack([np.cos(0.3 * (T - T[0])), *np.zeros((2, len(T))), np.sin(
    0.3 * (T - T[0]))])


def bag(path: Path, plugin: str) -> Path:
    """Writes a rosbag2 by the writer of `rosbags`."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="needs uvms_drake[logs]")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.LATEST)
    of = store.types

    def stamp(time):
        return of["std_msgs/msg/Header"](stamp=of["builtin_interfaces/msg/Time"](
            sec=int(time), nanosec=round(1e9 * (time % 1.0))), frame_id="base_link")

    with rosbag2.Writer(path, version=9,
                        storage_plugin=rosbag2.StoragePlugin[plugin]) as writer:
        imu = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        arm = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
        vector, quaternion = of["geometry_msgs/msg/Vector3"], of["geometry_msgs/msg/Quaternion"]
        for time, (w, x, y, z), rate, q in zip(T, WXYZ, GYRO, Q, strict=True):
            at = round(1e9 * time)
            message = of["sensor_msgs/msg/Imu"](
                header=stamp(time), orientation=quaternion(x=x, y=y, z=z, w=w),
                angular_velocity=vector(*rate), linear_acceleration=vector(0.0, 0.0, 9.81),
                **{each.name: np.zeros(9) for each in fields(of["sensor_msgs/msg/Imu"])
                   if each.name.endswith("covariance")})
            writer.write(imu, at, store.serialize_cdr(message, imu.msgtype))
            message = of["sensor_msgs/msg/JointState"](
                header=stamp(time), name=["a", "b", "c", "d"], position=q,
                velocity=np.zeros(4), effort=np.zeros(0))
            writer.write(arm, at, store.serialize_cdr(message, arm.msgtype))
    return path


@pytest.mark.parametrize("plugin", ["SQLITE3", "MCAP"])
def test_a_rosbag2_has_the_signals_that_were_written(plugin, tmp_path):
    path, signals = bag(tmp_path / "bag", plugin), declared(ROS_SIGNALS)
    compared(path, signals, attitude=WXYZ[:, [1, 2, 3, 0]], angular_velocity=GYRO, joints=Q)
    log = read_log(path, 4, signals)
    assert log.q.shape == (len(log.time), 4) and len(digest(path, signals)) == 64
    np.testing.assert_allclose(log.q[5:-5, 0], np.sin(log.time[5:-5]), atol=0.01)
    with pytest.raises(InvalidParameter, match=r"file = '/odom': .* /imu, /joint_states"):
        read_log(path, 4, declared(ROS_SIGNALS.replace("/imu", "/odom")))
    with pytest.raises(InvalidParameter, match=r"column = 'orientation\.a': .* one of time_s"):
        read_log(path, 4, declared(ROS_SIGNALS.replace("orientation.x", "orientation.a")))


# ArduSub.


TLOG_SIGNALS = """
signals:
  - {signal: attitude, file: ATTITUDE, time: time_boot_ms, time_unit: ms,
     columns: [roll, pitch, yaw]}
  - {signal: angular_velocity, file: ATTITUDE, columns: [rollspeed, pitchspeed, yawspeed]}
"""
BIN_SIGNALS = """
signals:
  - {signal: attitude, file: ATT, time: TimeUS, time_unit: us, unit: deg,
     columns: [Roll, Pitch, Yaw]}
  - {signal: angular_velocity, file: "IMU[1]", time: TimeUS, time_unit: us,
     columns: [GyrX, GyrY, GyrZ]}
"""


def test_a_telemetry_log_has_the_signals_that_were_written(tmp_path):
    """Packets of pymavlink, each after its time of receipt in microseconds."""
    mavlink = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega",
                                  reason="needs uvms_drake[logs]")
    path = tmp_path / "dive.tlog"
    sender = mavlink.MAVLink(None)
    with path.open("wb") as file:
        for time, rpy, rate in zip(T, RPY, GYRO, strict=True):
            boot = round(1e3 * (time - T[0])) + 5000
            file.write(struct.pack(">Q", round(1e6 * time)) + mavlink.MAVLink_attitude_message(
                boot, *rpy, *rate).pack(sender))
    compared(path, declared(TLOG_SIGNALS), attitude=RPY.astype(np.float32),
             angular_velocity=GYRO.astype(np.float32))


def described(kind: int, name: str, form: str, columns: str, size: int) -> bytes:
    """Returns the FMT message of a kind of messages of a DataFlash log."""
    return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", kind, size + 3, name.encode(),
                                         form.encode(), columns.encode())


def test_a_dataflash_log_has_the_signals_that_were_written(tmp_path):
    """In its public format: FMT messages, and those that they describe; of two IMUs the second."""
    pytest.importorskip("pymavlink", reason="needs uvms_drake[logs]")
    path = tmp_path / "00000012.BIN"
    attitude, imu = struct.Struct("<Qfff"), struct.Struct("<QBfff")
    with path.open("wb") as file:
        file.write(described(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns", 86))
        file.write(described(10, "ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw", attitude.size))
        file.write(described(11, "IMU", "QBfff", "TimeUS,I,GyrX,GyrY,GyrZ", imu.size))
        file.write(described(12, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds", 41))
        file.write(b"\xa3\x95\x0c" + struct.pack("<QB16s16s", 0, 11, b"s#EEE", b"F-000"))
        for time, rpy, rate in zip(T, np.rad2deg(RPY), GYRO, strict=True):
            now = round(1e6 * (time - T[0])) + 1000
            file.write(b"\xa3\x95\x0a" + attitude.pack(now, *rpy))
            for i in (0, 1):
                file.write(b"\xa3\x95\x0b" + imu.pack(now, i, *(i * rate)))
    compared(path, declared(BIN_SIGNALS), attitude=RPY, angular_velocity=GYRO)


def test_what_is_no_recording_or_lacks_its_package_is_one_line(tmp_path, monkeypatch):
    (tmp_path / "dive.tlog").write_bytes(b"")
    (tmp_path / "dive.mcap").write_bytes(b"none")
    assert is_recording(tmp_path / "dive.tlog") and not is_recording(tmp_path / "dive.csv")
    for module in ("pymavlink", "rosbags.highlevel"):
        monkeypatch.setitem(__import__("sys").modules, module, None)
    for name, signals in (("dive.tlog", TLOG_SIGNALS), ("dive.mcap", ROS_SIGNALS)):
        with pytest.raises(InvalidParameter, match=r"pip install 'uvms_drake\[logs\]'"):
            read_tables(tmp_path / name, declared(signals))
