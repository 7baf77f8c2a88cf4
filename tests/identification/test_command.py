"""Tests of the readers and of `uvms-drake identify`: logs as CSV files and of runs."""

import json
import re
import shutil
import textwrap
from dataclasses import replace

import numpy as np
import pytest
from pydrake.math import RollPitchYaw, RotationMatrix
from support.outputs import written
from support.synthetic import synthetic_record
from support.synthetic_logs import TRUTH, synthetic_logs

import uvms_drake as uv
from uvms_drake.command.main import main
from uvms_drake.common.errors import InvalidParameter
from uvms_drake.common.schema import load_file
from uvms_drake.identification.identify import LEAST_WINDOWS
from uvms_drake.identification.log import SIZES, gravity_in_body
from uvms_drake.identification.readers import digest, read_log
from uvms_drake.identification.signals_file import LogSignals
from uvms_drake.identification.windows import WINDOW
from uvms_drake.model.description.robot_files import model_dir
from uvms_drake.plant.waves import UnknownFlow, Wave

ROBOT = "bluerov2_alpha5"
ENU = """\
world: ENU
body: FLU
attitude: xyzw
joint_signs: [-1, 1, 1, 1]
signals:
  - {signal: attitude, columns: [x, y, z, w], file: _imu.csv, time: stamp, time_unit: ms}
  - {signal: angular_velocity, columns: [p, q, r], file: _imu.csv, time: stamp, time_unit: ms,
     unit: deg}
  - {signal: specific_force, columns: [ax, ay, az], file: _imu.csv, time: stamp, time_unit: ms,
     unit: g}
  - {signal: position, columns: [east, north, up], file: _imu.csv, time: stamp, time_unit: ms}
  - {signal: joints, columns: [a, b, c, d], file: _arm.csv, time: t, delay: 0.2}
"""
PLAIN = """\
signals:
  - {signal: attitude, columns: [roll, pitch, yaw]}
  - {signal: angular_velocity, columns: [p, q, r]}
  - {signal: joints, columns: [q0, q1, q2, q3]}
"""


def write_table(path, **columns):
    path.write_text("\n".join([",".join(columns), *(
        ",".join(f"{cell:.10g}" for cell in row)
        for row in np.column_stack(list(columns.values())))]) + "\n", encoding="utf-8")


def signals_in(folder, text):
    (folder / "signals.yaml").write_text(text, encoding="utf-8")
    return folder / "signals.yaml"


def write_plain(log, path):
    """Writes joints, attitude and gyro of a log; the heading is the integral of its rate."""
    roll, pitch, p, q, r = log.state[:, [0, 1, 6, 7, 8]].T
    rate = (np.sin(roll) * q + np.cos(roll) * r) / np.cos(pitch)
    yaw = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(log.time))])
    write_table(path, time_s=log.time, roll=roll, pitch=pitch, yaw=yaw, p=p, q=q, r=r,
                **{f"q{i}": each for i, each in enumerate(log.q.T)})


def test_csv_files_in_declared_axes_units_and_clocks_are_a_log_in_the_models(tmp_path):
    time = np.arange(0.0, 6.0, 0.02)
    rpy = np.column_stack([0.2 * np.sin(time), 0.1 * np.cos(0.7 * time), 3.0 + 0.1 * time])
    R = [RollPitchYaw(each).ToRotationMatrix().matrix() for each in rpy]
    to_ned, to_frd = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1.0]]), np.diag([1.0, -1.0, -1.0])
    wxyz = np.array([RotationMatrix(to_ned.T @ each @ to_frd).ToQuaternion().wxyz() for each in R])
    turning = np.array([RollPitchYaw(each).CalcAngularVelocityInChildFromRpyDt(rate)
                        for each, rate in zip(rpy, np.gradient(rpy, time, axis=0), strict=True)])
    up = -gravity_in_body(np.column_stack([rpy, np.zeros((len(time), 6))]))
    q = np.column_stack([np.sin(time + i) for i in range(4)])
    write_table(tmp_path / "run_imu.csv", stamp=1e3 * time,
                **dict(zip("xyzw", wxyz[:, [1, 2, 3, 0]].T, strict=True)),
                **dict(zip("pqr", np.rad2deg(turning @ to_frd).T, strict=True)),
                **dict(zip(("ax", "ay", "az"), (up @ to_frd).T / 9.80665, strict=True)),
                east=0.0 * time, north=0.0 * time, up=-2.0 - 0.1 * time)
    write_table(tmp_path / "run_arm.csv", t=time + 0.2,
                **dict(zip("abcd", (q * [-1, 1, 1, 1]).T, strict=True)))
    signals = load_file(signals_in(tmp_path, ENU), LogSignals)
    log = read_log(tmp_path / "run", 4, signals)
    inner = slice(10, -10)
    at = log.time[inner]
    assert log.name == str(tmp_path / "run") and at[-1] > 5.0
    for found, exact in (
            (log.q, np.column_stack([np.sin(at + i) for i in range(4)])),
            (log.q_dot, np.column_stack([np.cos(at + i) for i in range(4)])),
            (log.state[:, :2], np.column_stack([0.2 * np.sin(at), 0.1 * np.cos(0.7 * at)])),
            (log.state[:, 2:3], 2.0 + 0.1 * at[:, None]),
            (log.state[:, 6:], np.column_stack([np.interp(at, time, each) for each in turning.T])),
            (log.specific_force, np.column_stack([np.interp(at, time, each) for each in up.T]))):
        np.testing.assert_allclose(found[inner], exact, atol=0.01)
    assert np.all(np.isnan(log.state[:, 3:6])) and not np.any(log.wrench)


def test_the_log_of_a_run_is_read_and_only_in_still_water(tmp_path):
    record = synthetic_record(4.0)
    record.save(tmp_path / "still")
    log = read_log(tmp_path / "still", 4, None)
    assert log.name == str(tmp_path / "still") and np.any(log.touching)
    np.testing.assert_allclose(np.interp(1.0, log.time, log.wrench[:, 0]), 30.0 * np.sin(1.0),
                               atol=0.1)
    for changes, line in (
            ({"current": np.array([0.1, 0.0, 0.0])}, "the run has a current of 0.1 m/s"),
            ({"waves": [Wave()]}, "the run has waves"),
            ({"faults": [UnknownFlow()]}, "the run has an unknown flow")):
        replace(record, scenario=replace(record.scenario, **changes)).save(tmp_path / "moving")
        with pytest.raises(InvalidParameter, match=f"still water: {line}"):
            read_log(tmp_path / "moving", 4, None)
        assert read_log(tmp_path / "moving" / "log.npz", 4, None).q.shape == log.q.shape
    # Beside other logs, whose signals are declared, too.
    signals = load_file(signals_in(tmp_path, ENU), LogSignals)
    file = tmp_path / "moving" / "log.npz"
    assert digest(file, signals) == digest(file, None)


@pytest.mark.parametrize(("log", "signals", "line"), [
    ("none", PLAIN, "none'.* a CSV file of numbers"),
    ("flight.BIN", PLAIN, r"flight.BIN.*(uvms_drake\[logs\]|none: it is empty)"),
    ("run.csv", None, "--signals = None: .*run.csv"),
    ("run.csv", PLAIN + "  - {signal: depth, columns: [altitude]}\n",
     r"run.csv: depth = -2\.0: must be positive down"),
    ("run.csv", PLAIN.replace("r]", "heading]"), "run.csv: column = 'heading'.* one of time_s"),
    ("run.csv", PLAIN.rpartition("  -")[0], "run.csv: signals = .* joints among them"),
    ("run.csv", PLAIN.replace("[q0, q1, q2, q3]", "[]"), r"signals\[2\].columns = \[\]"),
    ("run.csv", "joint_signs: [1, -1]\n" + PLAIN, "joint_signs = .* one number, or 4 of them"),
    ("bare.npz", None, "bare.npz'.* with force, and exerted or tau"),
    ("empty.npz", None, "empty.npz'.* a log of a run")])
def test_bad_input_is_one_line_and_status_2(log, signals, line, tmp_path, capsys):
    time = np.arange(0.0, 3.0, 0.05)
    write_table(tmp_path / "run.csv", time_s=time, **{name: np.sin(time) for name in (
        "roll", "pitch", "yaw", "p", "q", "r", "q0", "q1", "q2", "q3")},
                altitude=np.full(len(time), -2.0))
    (tmp_path / "flight.BIN").write_bytes(b"\xa3\x95\x80\x80\x59FMT\x00")
    np.savez(tmp_path / "bare.npz", time=time, state=np.zeros((len(time), 20)))
    np.savez(tmp_path / "empty.npz", time=time)
    extra = [] if signals is None else ["--signals", str(signals_in(tmp_path, signals))]
    output = tmp_path / "out"
    assert main(["identify", ROBOT, str(tmp_path / log), *extra, "--output", str(output)]) == 2
    out, err = capsys.readouterr()
    assert err.count("\n") == 1 and not out and not output.exists()
    assert re.search(line, err), err


def test_a_folder_may_have_the_files_of_a_dive_and_columns_of_text(tmp_path):
    (tmp_path / "dive").mkdir()
    time = np.arange(0.0, 3.0, 0.05)
    write_table(tmp_path / "plain.csv", time_s=time, **{name: 0.1 * np.sin(time) for name in (
        "roll", "pitch", "yaw", "p", "q", "r", "q0", "q1", "q2", "q3")})
    header, *rows = (tmp_path / "plain.csv").read_text("utf-8").splitlines()
    (tmp_path / "dive" / "all.csv").write_text("\n".join(
        [f"frame_id,{header}", *(f"base_link,{row}" for row in rows)]), encoding="utf-8")
    signals = load_file(signals_in(tmp_path, PLAIN.replace("],", "]}").replace("]}", "], file: F}")
                                   .replace("F}", "/all.csv}")), LogSignals)
    log = read_log(tmp_path / "dive", 4, signals)
    np.testing.assert_allclose(log.state[:, 0], 0.1 * np.sin(log.time), atol=1e-3)
    assert digest(tmp_path / "dive", signals)


def test_the_help_has_the_signals_and_numbers_of_the_code_and_a_file_that_is_read(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["identify", "--help"])
    said = capsys.readouterr().out
    assert f"At least {LEAST_WINDOWS} windows of {WINDOW:g} s" in " ".join(said.split())
    listed = said.partition("Signals: ")[2].partition(" `file`")[0]
    assert set(SIZES) | {"position", "armed"} <= set(re.findall(r"\w+", listed))
    sample = textwrap.dedent(re.search(r"(?m)^  world:(?:.*\n)+?(?=\n)", said)[0])
    signals = load_file(signals_in(tmp_path, sample), LogSignals)
    assert signals.world == "ENU" and [each.signal for each in signals.signals] == [
        "attitude", "joints"]


@pytest.mark.slow
def test_the_command_writes_a_robot_and_unknowns_that_are_read_back(tmp_path, capsys):
    logs = synthetic_logs(ROBOT, 1, 5)
    paths = [tmp_path / f"{log.name}.csv" for log in logs]
    for log, path in zip(logs, paths, strict=True):
        write_plain(log, path)
    output = tmp_path / "found"
    assert main(["identify", ROBOT, *map(str, paths), "--signals",
                 str(signals_in(tmp_path, PLAIN)), "--output", str(output), "--quiet"]) == 0
    out = capsys.readouterr().out
    assert {"hydrodynamics.yaml", "unknowns.yaml", "identification.json", "identification.html",
            "validation.png", "parameters.png", "residual.png"} == written(output)
    # The numbers, within their intervals.
    data = json.loads((output / "identification.json").read_text(encoding="utf-8"))
    roll = data["parameters"]["vehicle.added_mass.roll"]
    low, high = roll["interval"]
    assert low < (1.0 + TRUTH["vehicle.added_mass.roll"]) * roll["file"] < high
    assert "vehicle.added_mass.roll" in out and str(paths[0]) in data["logs"]
    # The robot with its new file, and a scenario with the unknowns.
    folder = tmp_path / ROBOT
    shutil.copytree(model_dir(ROBOT), folder)
    shutil.copy(output / "hydrodynamics.yaml", folder)
    body = uv.Robot.load(folder).uvms.hydrodynamics.bodies["vehicle"]
    assert body.added_mass[0].matrix[3] == pytest.approx(roll["value"], rel=1e-5)
    unknowns = (output / "unknowns.yaml").read_text(encoding="utf-8")
    assert "# Intervals, no bounds" in unknowns and "[m/s², rad/s²]" in unknowns
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(f"base: bluerov2_contact\n{unknowns}", encoding="utf-8")
    loaded = uv.load_scenario(str(scenario))
    assert len(loaded.identified.logs) == 5
    loaded.identified.check_robot(str(folder))
    with pytest.raises(InvalidParameter, match="identify has written another one"):
        loaded.identified.check_robot(ROBOT)
    factor = loaded.model_error.by_axis("vehicle", "added_mass")[3]
    assert factor - 1.0 == pytest.approx((high - low) / 2.0 / roll["value"], abs=2e-4)
    # The page.
    page = (output / "identification.html").read_text(encoding="utf-8")
    assert f"<title>Identification of {ROBOT}: report</title>" in page
    assert page.count("<figure") == 3 and "$" not in page
