"""Tests of `uvms_drake.certificate.certificate`: the artefact."""

import json
from dataclasses import replace

import numpy as np
import pytest

from uvms_drake.certificate.certificate import (
    CERTIFICATE_FILE,
    Certificate,
    TerminalResult,
    fingerprint,
    read_certificate,
    stale_reason,
    write_certificate,
)
from uvms_drake.common.errors import RunFailed
from uvms_drake.control.limits import HoldRadii, TubeRadii
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.constants import Constant
from uvms_drake.tube.estimates import Estimate


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("girona500_ideal")


@pytest.fixture(scope="module")
def certificate(scenario) -> Certificate:
    worst = {"config": np.arange(10.0), "zeta": np.zeros(10)}
    return Certificate(
        scenario="girona500_ideal", law="resolved", k=20.0, sigma=5.0, d_bound=0.1,
        constants=(Constant("J_max", 2.5, "estimated", 100, worst, 1.1, 2.3),),
        conditions=(Condition("a", 1.0, ">", 0.0, theorem="t"),
                    Condition("b", 2.0, "<=", 2.0, theorem="t")),
        tube=TubeRadii(e=0.003, z=0.02, u=np.full(10, 0.1), tau=np.full(10, np.inf)),
        terminal=TerminalResult(0.5, "u[1] end", {"decrease": 0.1}, 10, np.eye(20), np.eye(10, 20)),
        estimates=(Estimate("ω", 1.1, 0.9),), tightening=3, proven=1,
        bounds={"force": 2.5}, **fingerprint(scenario))


def test_a_certificate_survives_its_file(certificate, tmp_path):
    write_certificate(certificate, tmp_path)
    again = read_certificate(tmp_path / CERTIFICATE_FILE)
    assert again.to_data() == certificate.to_data()
    assert again.certified
    assert again.estimates == certificate.estimates
    np.testing.assert_array_equal(again.tube.tau, np.inf)


def test_weights_are_in_the_file_where_there_are_some(certificate):
    assert "weights" not in certificate.to_data()
    weights = np.linspace(0.1, 1.0, 10)
    data = replace(certificate, weights=weights).to_data()
    assert data["weights"] == weights.tolist()
    again = Certificate.from_data(data)
    np.testing.assert_array_equal(again.weights, weights)
    assert again.to_data() == data


def test_the_radii_of_a_hold_survive_their_file(certificate):
    hold = HoldRadii(1.3, 4e-4, 6e-4, 0.016, 0.0025, 2.1, 0.03)
    data = replace(certificate, tube=TubeRadii(hold=hold, u=np.zeros(0))).to_data()
    again = Certificate.from_data(json.loads(json.dumps(data)))
    assert again.tube.hold == hold and again.tube.likely_hold is None
    assert again.to_data() == data


def test_one_changed_number_is_found(certificate, tmp_path):
    write_certificate(certificate, tmp_path)
    path = tmp_path / CERTIFICATE_FILE
    data = json.loads(path.read_text())
    data["tube"]["e"] = 0.001
    path.write_text(json.dumps(data))
    with pytest.raises(RunFailed, match="was changed"):
        read_certificate(path)


@pytest.mark.parametrize("text", ["", "{}", "[]", "not JSON", '{"sha256": 1}'])
def test_what_is_no_certificate_is_refused(text, tmp_path):
    path = tmp_path / CERTIFICATE_FILE
    path.write_text(text)
    with pytest.raises(RunFailed):
        read_certificate(path)


@pytest.mark.parametrize(("override", "stale"), [
    ("seed=3", False), ("duration=2", False), ("tube.e=0.01", False),
    ("mpc.terminal_radius=0.1", False), ("description=another", False),
    ("task.force_tolerance=1", False), ("mpc.hover=2", False), ("current.0=0.1", True),
    ("disturbance.frequency=3", False),
    ("disturbance.bound=0.11", True),
    ("disturbance.weights=[1, 1, 1, 1, 1, 1, 2, 2, 2, 2]", True),
    ("limits.nu1=0.26", True), ("ancillary.k=19", True),
    ("surface.stiffness=1001", True), ("mpc.horizon=16", True), ("start.eta.0=-1.36", True),
    ("certificate.seed=1", True),
])
def test_a_certificate_is_stale_exactly_if_something_it_depends_on_has_changed(
        certificate, override, stale):
    other = load_scenario("girona500_ideal", [override])
    assert (stale_reason(certificate, other) is not None) == stale


def test_a_touched_file_of_the_robot_makes_it_stale(certificate, scenario):
    files = dict(certificate.files)
    assert {"girona500_arm5e.sdf", "hydrodynamics.yaml", "package.xml"} <= set(files)
    files["hydrodynamics.yaml"] = "0" * 64
    assert stale_reason(replace(certificate, files=files), scenario) == "a file of the robot"


def test_one_failed_condition_makes_it_failing(certificate):
    failing = certificate.adding([Condition("c", 1.0, "<", 0.5, theorem="t"),
                               Condition("d", np.nan, ">", 0.0, theorem="t")])
    assert not failing.certified
    assert failing.failed.name == "c"


def test_no_condition_is_no_certificate(certificate):
    assert not replace(certificate, conditions=()).certified


def test_a_certificate_puts_its_tube_and_terminal_set_into_the_scenario(certificate, scenario):
    applied = certificate.applied_to(scenario)
    assert applied.tube is certificate.tube
    assert applied.mpc.terminal_radius == 0.5
    assert scenario.mpc.terminal_radius != 0.5
