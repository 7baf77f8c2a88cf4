"""The file of certificates of both kinds: it comes back whole, and what has changed is found."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support.probability import NAME, made

from uvms_drake.certificate.certificate import (
    CERTIFICATE_FILE,
    Certificate,
    fingerprint,
    from_data,
    probability_fingerprint,
    read_certificate,
    stale_reason,
    to_data,
    write_certificate,
)
from uvms_drake.certificate.claims import TerminalResult
from uvms_drake.certificate.declared_unknowns import UnknownEffect
from uvms_drake.command.certificates import sound
from uvms_drake.common.errors import RunFailed
from uvms_drake.control.limits import HoldRadii, TubeRadii
from uvms_drake.station.contact.mission_legs import Leg
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.tube.conditions import Condition
from uvms_drake.tube.constants import Constant
from uvms_drake.tube.estimates import Estimate


@pytest.fixture(scope="module")
def scenario():
    return load_scenario("girona500_ideal")


@pytest.fixture(scope="module")
def certificate(scenario) -> Certificate:
    hold = HoldRadii(1.3, 4e-4, 6e-4, 0.016, 0.0025, 2.1, 0.03)
    return Certificate(
        scenario="girona500_ideal", law="resolved", k=20.0, sigma=5.0, d_bound=0.1,
        weights=np.linspace(0.1, 1.0, 10),
        constants=(Constant("J_max", 2.5, "estimated", 100, 2.3),),
        conditions=(Condition("a", 1.0, ">", 0.0, theorem="t"),
                    Condition("b", 2.0, "<=", 2.0, theorem="t", kind="tightening", proven=True)),
        tube=TubeRadii(e=0.003, z=0.02, u=np.full(10, 0.1), tau=np.full(10, np.inf), hold=hold),
        unknowns=(UnknownEffect("mass", (0.1, 0.2), 0.3, np.nan),),
        budget={"depth": {"noise": 1e-3}}, margin={"depth": np.inf},
        legs=(Leg("Hold", 10.0, 8.5, 5.0, 60.0, "", 3.25), Leg("Slide", 12.0, None, 1.0, 2.0, "")),
        terminal=TerminalResult(0.5, "u[1] end", {"decrease": 0.1}, 10, np.eye(20), np.eye(10, 20)),
        estimates=(Estimate("ω", 1.1, 0.9),), bounds={"force": np.inf}, **fingerprint(scenario))


def test_a_certificate_of_each_kind_survives_its_file(certificate, scenario, tmp_path):
    bare = Certificate(scenario="s", law="resolved", k=np.nan, sigma=1.0, d_bound=0.1)
    for known, kind in ((certificate, "worst case"), (bare, "worst case"),
                        (made((1,), mission="approach, slide"), "in probability")):
        write_certificate(known, tmp_path)
        again = read_certificate(tmp_path / CERTIFICATE_FILE)
        assert type(again) is type(known)
        assert to_data(again) == to_data(known)
        assert to_data(known)["kind"] == kind
        assert again.certified == known.certified == to_data(known)["certified"]
    again = from_data(json.loads(json.dumps(to_data(certificate))))
    assert again.conditions == certificate.conditions and again.legs == certificate.legs
    assert again.tube.hold == certificate.tube.hold and again.tube.likely_hold is None
    assert again.bounds["force"] == again.margin["depth"] == np.inf
    for found, expected in ((again.weights, certificate.weights), (again.tube.tau, np.inf),
                            (again.terminal.gain, np.eye(10, 20))):
        np.testing.assert_array_equal(found, np.broadcast_to(expected, found.shape))


@pytest.mark.parametrize(("change", "said"), [
    (lambda data: data | {"d_bound": 0.2}, "it was changed; make it again with 'certify'"),
    (lambda data: {key: data[key] for key in data if key not in ("format", "sha256")},
     "it was changed"),
    (lambda data: {}, "it was changed"), (lambda data: [], "it was changed")])
def test_a_changed_file_is_refused_in_a_line(change, said, certificate, tmp_path):
    path = tmp_path / CERTIFICATE_FILE
    path.write_text(json.dumps(change(to_data(certificate))))
    with pytest.raises(RunFailed, match=said) as caught:
        read_certificate(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_a_file_of_another_version_is_refused_with_the_reason(
        certificate, tmp_path, monkeypatch):
    """Untouched: a digest that fits, and no number of a format, or another."""
    monkeypatch.setattr("uvms_drake.certificate.certificate.FORMAT", 1)
    write_certificate(certificate, tmp_path)
    monkeypatch.undo()
    with pytest.raises(RunFailed, match="in the format of another version of uvms_drake; make"):
        read_certificate(tmp_path / CERTIFICATE_FILE)


@pytest.mark.parametrize(("override", "stale"), [
    ("seed=3", False), ("duration=2", False), ("tube.e=0.01", False),
    ("mpc.terminal_radius=0.1", False), ("description=another", False),
    ("task.force_tolerance=1", False), ("mpc.hover=2", False), ("current.0=0.1", True),
    ("disturbance.frequency=3", False), ("disturbance.bound=0.11", True),
    ("disturbance.weights=[1, 1, 1, 1, 1, 1, 2, 2, 2, 2]", True),
    ("limits.nu1=0.26", True), ("ancillary.k=19", True), ("surface.stiffness=1001", True),
    ("mpc.horizon=16", True), ("start.eta.0=-1.36", True), ("certificate.seed=1", True)])
def test_a_certificate_is_stale_exactly_if_something_it_depends_on_has_changed(
        certificate, override, stale):
    other = load_scenario("girona500_ideal", [override])
    assert (stale_reason(certificate, other) is not None) == stale


@pytest.mark.parametrize(("change", "reason"), [
    ("seed=4", None), ("description=another", None), ("log_period=0.1", "the scenario"),
    ("ancillary.tip.k=19", "the scenario"), ("tube.z=0.4", "the scenario"),
    ("contact.friction=0.4", "the scenario"), ("mpc.hover=3", "the scenario"),
    ("disturbance.bound=0.01", "the scenario"),
    ("faults=[!SolverFailure {probability: 1.0}]", "the scenario")])
def test_one_in_probability_is_of_the_whole_scenario(change, reason):
    assert stale_reason(made(), load_scenario(NAME, [change])) == reason


def test_another_robot_or_program_makes_it_stale(certificate, scenario):
    files = dict(certificate.files)
    assert {"girona500_arm5e.sdf", "hydrodynamics.yaml", "package.xml"} <= set(files)
    files["hydrodynamics.yaml"] = "0" * 64
    assert stale_reason(replace(certificate, files=files), scenario) == "a file of the robot"
    versions = {"uvms_drake": "0", "drake": "0"}
    assert stale_reason(replace(certificate, versions=versions), scenario) == "a version"
    assert stale_reason(made(source="another"), load_scenario(NAME)) == "this package"
    assert "source" in probability_fingerprint(scenario)


def test_a_certificate_holds_if_every_condition_does(certificate):
    assert certificate.certified and certificate.failed is None
    failing = replace(certificate, conditions=(
        *certificate.conditions, Condition("c", 1.0, "<", 0.5, theorem="t"),
        Condition("d", np.nan, ">", 0.0, theorem="t")))
    assert not failing.certified
    assert failing.failed.name == "c"
    assert not replace(certificate, conditions=()).certified
    none = made((0, 1), runs=2, p=1.0)
    assert not none.certified
    with pytest.raises(RunFailed, match=f"^{NAME}: not certified in probability: every run failed"):
        sound(none, NAME)


def test_a_certificate_puts_its_tube_and_terminal_set_into_the_scenario(certificate, scenario):
    applied = certificate.applied_to(scenario)
    assert applied.tube is certificate.tube
    assert applied.mpc.terminal_radius == 0.5
    assert scenario.mpc.terminal_radius != 0.5
    assert made().applied_to(scenario) is scenario
