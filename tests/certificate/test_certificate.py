"""Certificates: their file, what has changed, their words, and the bound of a probability."""

import json
import shutil
from dataclasses import fields, replace
from fractions import Fraction
from math import comb
from pathlib import Path

import numpy as np
import pytest
from support.probability import NAME, made
from support.snapshot import check_snapshot
from support.synthetic import synthetic_record

import uvms_drake as uv
from uvms_drake.campaign.campaign import make_campaign
from uvms_drake.certificate.assumptions import assumed_conditions, assumptions_of
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
from uvms_drake.certificate.certify import basis_of
from uvms_drake.certificate.claims import TerminalResult
from uvms_drake.certificate.declared_unknowns import UnknownEffect
from uvms_drake.certificate.in_probability import binomial_tail, failure_bound, percent_above
from uvms_drake.certificate.text import (
    HELP,
    format_overview,
    format_probability,
    help_for,
    largest_force,
    tightest_limit,
)
from uvms_drake.command.certificates import sound
from uvms_drake.control.limits import HoldRadii, TubeRadii
from uvms_drake.model.description.robot_files import model_dir
from uvms_drake.station.contact.mission_legs import Leg
from uvms_drake.tube.conditions import Condition, assumption
from uvms_drake.tube.constants import Constant
from uvms_drake.tube.contact.tip_motion import JERK
from uvms_drake.tube.estimates import Estimate
from uvms_drake.tube.law_tube import WEIGHTED
from uvms_drake.tube.ultimate_bounds import HOLD, LIKELY


@pytest.fixture(scope="module")
def scenario():
    return uv.load_scenario("girona500_ideal")


@pytest.fixture(scope="module")
def certificate(scenario, contact) -> Certificate:
    found = full(contact)
    return replace(
        found, bounds={"force": np.inf}, margin={"depth": np.inf}, **fingerprint(scenario),
        tube=replace(found.tube, tau=np.full(10, np.inf), likely_hold=None))


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
    with pytest.raises(uv.RunFailed, match=said) as caught:
        read_certificate(path)
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)


def test_a_file_of_another_version_is_refused_with_the_reason(
        certificate, tmp_path, monkeypatch):
    """Untouched: a digest that fits, and no number of a format, or another."""
    monkeypatch.setattr("uvms_drake.certificate.certificate.FORMAT", 1)
    write_certificate(certificate, tmp_path)
    monkeypatch.undo()
    with pytest.raises(uv.RunFailed, match="in the format of another version of uvms_drake; make"):
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
    other = uv.load_scenario("girona500_ideal", [override])
    assert (stale_reason(certificate, other) is not None) == stale


@pytest.mark.parametrize(("change", "reason"), [
    ("seed=4", None), ("description=another", None), ("log_period=0.1", "the scenario"),
    ("duration=50", "the scenario"), ("contact.force_line=3", "the scenario"),
    ("ancillary.tip.k=19", "the scenario"), ("tube.z=0.4", "the scenario"),
    ("contact.friction=0.4", "the scenario"), ("mpc.hover=3", "the scenario"),
    ("disturbance.bound=0.01", "the scenario"),
    ("faults=[!SolverFailure {probability: 1.0}]", "the scenario"),
    ("simulator.integration_scheme=explicit_euler", "the scenario"),
    ("simulator.max_step_size=0.005", None)])
def test_one_in_probability_is_of_the_whole_scenario(change, reason):
    assert stale_reason(made(), uv.load_scenario(NAME, [change])) == reason


def test_the_force_line_of_drawn_runs_is_none_of_the_worst_case():
    assert len({fingerprint(uv.load_scenario("girona500_contact", [f"contact.force_line={line}"]))[
        "inputs"] for line in ("null", "2", "3")}) == 1


@pytest.mark.parametrize("change", [
    "log_period=0.4", "faults=[!SolverFailure {duration: 3.0}]",
    "faults=[!SolverFailure {probability: 0.5}]"])
def test_the_silence_of_a_supervisor_is_of_readings_and_plans(change):
    """Which a certificate without one does not depend on."""
    for supervisor, same in (("supervisor=null", True), ("supervisor={}", False)):
        inputs = {fingerprint(uv.load_scenario("girona500_contact", [supervisor, *more]))["inputs"]
                  for more in ([], [change])}
        assert (len(inputs) == 1) == same


def test_another_robot_or_program_makes_it_stale(certificate, scenario):
    files = dict(certificate.files)
    assert {"girona500_arm5e.sdf", "hydrodynamics.yaml", "package.xml"} <= set(files)
    files["hydrodynamics.yaml"] = "0" * 64
    assert stale_reason(replace(certificate, files=files), scenario) == "a file of the robot"
    versions = {"uvms_drake": "0", "drake": "0"}
    assert stale_reason(replace(certificate, versions=versions), scenario) == "a version"
    assert stale_reason(made(source="another"), uv.load_scenario(NAME)) == "this package"
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
    with pytest.raises(uv.RunFailed, match="not certified in probability: every run failed"):
        sound(none, NAME)


def test_a_certificate_puts_its_tube_and_terminal_set_into_the_scenario(certificate, scenario):
    applied = certificate.applied_to(scenario)
    assert applied.tube is certificate.tube
    assert applied.mpc.terminal_radius == 0.5
    assert scenario.mpc.terminal_radius != 0.5
    assert made().applied_to(scenario) is scenario


def tightened(label: str, radius: float, limit: float, *, proven: bool = False) -> Condition:
    """Returns the condition that the tube leaves something of a limit."""
    return Condition(f"tube in limits.{label}", radius, "<", limit, theorem="t", kind="tightening",
                     topic="limits.u" if label[0] == "u" else "", about=label, proven=proven)


HOLDS = Certificate(
    scenario="girona500_contact", law="resolved", k=50.0, sigma=50.0, d_bound=0.1,
    bounds={"position": 0.002041, "orientation": 0.007, "force": 16.79},
    estimates=(Estimate("ω", 1.0, 0.5), Estimate("u", 2.0, 1.8)),
    conditions=(Condition("fine", 1.0, ">", 0.0, theorem="t"),
                assumption("faults", "which the proofs do not cover", 0.0, theorem="t"),
                tightened("q1", 0.01, 0.25, proven=True), tightened("u_heave", 0.56, 0.7),
                tightened("nu1", 0.007, 0.15)))
LEGS = (Leg("Approach", 10.0, None, 1.0, 60.0, ""), Leg("Hold", 12.0, 8.5, 5.0, 60.0, ""),
        Leg("Slide", 10.0, 11.0, 25.0, 50.0, "mission.steps[2], how fast: 2 <= 1"))


@pytest.fixture(scope="module")
def contact():
    return uv.load_scenario("girona500_contact")


def full(contact) -> Certificate:
    """Returns a certificate with something of everything."""
    hold = HoldRadii(time=1.31, depth=4e-4, position=6e-4, advance=0.0156, standing=0.0025,
                     reading=2.13, age=0.03)
    numbers = [2.5] * (len(fields(TubeRadii)) - 4)  # But for those of u, of τ and of the holds.
    return replace(
        HOLDS, weights=np.linspace(0.1, 1.0, 10), legs=LEGS,
        constants=tuple(Constant(name, 1.5, "estimated", 9, 1.25)
                        for name in ("J_max", "Jx_max", *WEIGHTED.values())),
        tube=TubeRadii(*numbers, u=np.array([0.5, 0.25]), tau=np.array([8.0]), hold=hold,
                       likely_hold=hold),
        unknowns=(UnknownEffect("drag off by 0.02", (0.1, 0.2), 0.3),
                  UnknownEffect("a current of 0.1 m/s", (0.2, 0.1), 0.4)),
        budget={"depth": {"noise": 1e-3, "d": 2e-3}, "joints": {"noise": 0.0, "d": 1e-3}},
        margin={"depth": 0.01},
        terminal=TerminalResult(
            0.5, "u_sway, end of a step", {"decrease": 0.1}, 10, np.eye(20), np.eye(10, 20)),
        bounds=HOLDS.bounds | {HOLD: 6.12, LIKELY: 4.95},
        assumptions=assumptions_of(contact, uv.load_model(contact)))


def failing() -> Certificate:
    """Returns a certificate with conditions of every kind that do not hold."""
    return replace(HOLDS, conditions=(
        *HOLDS.conditions, tightened("u_sway", 0.5, 0.3),
        Condition("first plan, distance to the terminal set", 2.0, "<=", 1.0,
                  "--set mpc.horizon=23", theorem="t", topic="first plan to the terminal set"),
        assumption("faults", "which the proofs do not cover", 2.0, theorem="t"),
        Condition("unheard of", np.nan, "<=", 1.0, theorem="t")))


def test_the_texts_of_certificates_are_as_they_were_read(contact):
    check_snapshot("certificate", str(full(contact)))
    check_snapshot("certificate_bare", str(HOLDS))
    check_snapshot("certificate_short", format_overview(full(contact), contact, "in 27.3 s"))
    check_snapshot("certificate_failing", format_overview(failing(), contact))
    named = {"inputs": 64 * "a"}
    check_snapshot("certificate_in_probability", "\n\n".join(map(format_probability, (
        made(**named), made((2, 7, 9), p=0.123, mission="approach, slide", **named),
        made((0, 1), runs=2, p=1.0, **named)))))
    check_snapshot("certificate_in_probability_short", "\n\n".join([
        format_probability(made((2, 7, 9), p=0.123, **named), 12.3, full=False),
        format_probability(made((0, 1), runs=2, p=1.0, **named), full=False)]))


def test_the_numbers_of_the_short_text_are_those_of_the_certificate(contact):
    rows = {line[:18].strip(): line[18:]
            for line in format_overview(HOLDS, contact, "in 27.3 s").splitlines()}
    assert rows["largest force"].startswith(
        f"{contact.contact.force:.4g} N in motion, 36.79 N with the plan at its target, "
        "20 ± 16.8 N")
    assert rows["end-effector"] == "within 2.04 mm and 7 mrad of the plan"
    assert rows["tightest limit"] == (
        "u_heave: of its 0.7 the tube takes 0.56 (80 %), the plan has 0.14")
    assert rows["computed"] == "in 27.3 s"
    assert tightest_limit(HOLDS).name == "tube in limits.u_heave"
    assert tightest_limit(replace(HOLDS, conditions=())) is None


def test_the_force_is_limited_by_what_the_scenario_limits_and_held_by_the_hardest_step(contact):
    known = uv.load_scenario("girona500_ideal")
    assert largest_force(HOLDS, known).startswith(f"{known.limits.static_force:.4g} N in motion")
    assert largest_force(replace(HOLDS, bounds={}), known) == ""
    stood = replace(HOLDS, bounds=HOLDS.bounds | {HOLD: 3.25})
    assert " 23.25 N in a hold of 20 ± 3.25 N" in largest_force(stood, contact)
    assert " 21 N in a hold of 10 ± 11 N" in largest_force(replace(HOLDS, legs=LEGS), contact)
    steady = (*LEGS[:2], replace(LEGS[2], hold_band=2.0))
    assert " 20.5 N in a hold of 12 ± 8.5 N" in largest_force(replace(HOLDS, legs=steady), contact)


def test_the_verdict_is_the_first_failure_or_how_much_is_proven():
    assert HOLDS.verdict == (
        "certified: all 5 conditions hold; of the 3 numbers that tighten limits 1 are proven, 2 "
        "estimated (of each, a second search reached 50% to 90%)")
    felt = replace(HOLDS, estimates=(Estimate(JERK, 1.0, 0.9),))
    assert " 1 are proven, given the estimated jerk of the tip, 2 estimated" in felt.verdict
    assert failing().verdict.startswith(
        "not certified: tube in limits.u_sway: 0.5 < 0.3 does not hold by 0.2; what would help: ")
    assert str(failing()).count("DOES NOT HOLD") == 4


def test_every_topic_of_a_condition_has_its_advice():
    for topic, advice in HELP.items():
        assert help_for(Condition("...", 1.0, "<", 0.0, theorem="t", topic=topic)).endswith(advice)
    assert help_for(tightened("q1", 1.0, 0.0)).endswith(HELP["tightening"])
    for name in ("girona500_contact", "girona500_real_loop"):
        for condition in assumed_conditions(uv.load_scenario(name)):
            assert condition.topic in HELP or condition.about in (
                "axes that the robot's thrusters do not drive", "contact.tangential_lag")


@pytest.mark.parametrize(("runs", "confidence", "bound"), [
    (60, 0.95, 0.0487), (300, 0.95, 0.00994), (59, 0.95, 0.0495), (1, 0.95, 0.95),
    (459, 0.99, 0.00998)])
def test_without_a_failure_it_is_the_closed_form(runs, confidence, bound):
    """59 runs for 5 % at 95 % and 459 for 1 % at 99 % are Wilks's numbers."""
    found = failure_bound(runs, 0, confidence)
    assert found == pytest.approx(1.0 - (1.0 - confidence)**(1.0 / runs), rel=1e-12)
    assert found == pytest.approx(bound, rel=2e-3)


@pytest.mark.parametrize(("failures", "runs", "bound"), [
    (1, 10, 0.3942), (2, 20, 0.2826), (5, 100, 0.1023), (1, 60, 0.0766), (9, 10, 0.9949)])
def test_with_failures_it_is_that_of_clopper_and_pearson(failures, runs, bound):
    """Tables of the one-sided limit at 95 %."""
    assert failure_bound(runs, failures, 0.95) == pytest.approx(bound, abs=6e-5)


@pytest.mark.parametrize(("failures", "runs"), [(1, 7), (3, 60), (40, 60), (299, 300), (12, 5000)])
@pytest.mark.parametrize("confidence", [0.5, 0.95, 0.999])
def test_as_few_failures_have_the_remaining_probability(failures, runs, confidence):
    """The tail in exact arithmetic, at the bound and just below it."""
    p = failure_bound(runs, failures, confidence)
    tails = []
    for exact in (Fraction(p), Fraction(p * (1.0 - 1e-9))):
        small = exact.limit_denominator(10**12)
        tails.append(float(sum(comb(runs, i) * small**i * (1 - small)**(runs - i)
                               for i in range(failures + 1))) if runs < 100 else
                     binomial_tail(runs, failures, float(exact)))
    assert tails[0] == pytest.approx(1.0 - confidence, rel=1e-6)
    assert tails[1] > tails[0]


@pytest.mark.parametrize("true", [0.01, 0.1, 0.4])
def test_the_bound_of_simulated_runs_is_right_as_often_as_its_confidence(true):
    rng = np.random.Generator(np.random.Philox(4))
    counts = rng.binomial(40, true, 20_000)
    bounds = np.array([failure_bound(40, k, 0.9) for k in range(41)])
    right = np.mean(bounds[counts] >= true)
    assert right >= 0.9 - 3.0 * np.sqrt(0.9 * 0.1 / len(counts))
    assert right < 1.0 or failure_bound(40, 0, 0.9) > true


@pytest.mark.parametrize(("args", "key"), [
    ((0, 0, 0.95), "runs"), ((5, 6, 0.95), "failures"), ((5, -1, 0.95), "failures"),
    ((5, 0, 1.0), "confidence"), ((5, 0, 0.0), "confidence")])
def test_an_argument_out_of_its_range_is_refused(args, key):
    with pytest.raises(uv.InvalidParameter, match=f"^{key} = "):
        failure_bound(*args)


@pytest.mark.parametrize(("p", "text"), [
    (0.0487029, "4.88 %"), (0.0099361, "0.994 %"), (0.05, "5 %"), (0.63161, "63.2 %"),
    (1.0, "100 %"), (0.99999, "100 %"), (1.234e-4, "0.0124 %")])
def test_a_percentage_is_rounded_up(p, text):
    assert percent_above(p) == text
    assert float(text[:-2]) >= 100.0 * p - 1e-12


def test_a_hold_is_said_by_its_time_and_speeds(contact):
    assert HOLDS.hold_condition == ""
    assert full(contact).hold_condition == (
        "the plan at its target, not clipped by `deepest`, and for 1.3 s slower than 2 mm/s, "
        "2 mrad/s and joints 10 mrad/s")


def test_how_a_robots_folder_is_named_is_no_input(tmp_path, monkeypatch):
    """Its files count by their content; the path in the file of a run is absolute."""
    robot = shutil.copytree(model_dir("girona500_arm5e"), tmp_path / "lab" / "girona500_arm5e")
    (robot.parent / "mine.yaml").write_text(
        "base: girona500_ideal\nmodel: girona500_arm5e/../girona500_arm5e\n", "utf-8")
    monkeypatch.chdir(tmp_path)
    near, far = (uv.load_scenario(str(path / "mine.yaml"))
                 for path in (Path("lab"), tmp_path / "lab"))
    assert near.model != far.model
    assert fingerprint(near) == fingerprint(far)
    assert probability_fingerprint(near) == probability_fingerprint(far)
    assert make_campaign(near, 0, None) == make_campaign(far, 0, None)
    record = replace(synthetic_record(2.0), scenario=near)
    (tmp_path / "out").mkdir()
    record.save(tmp_path / "out")
    monkeypatch.chdir(tmp_path / "out")
    assert uv.load_scenario("scenario.yaml").model == str(robot)


def test_constants_of_another_task_frame_are_others(monkeypatch):
    """Angles about another frame are stretched otherwise, and half-spaces are tilted."""
    keys = []
    monkeypatch.setattr("uvms_drake.certificate.certify.cached",
                        lambda key, compute: keys.append(json.dumps(key)) or {})
    for frame in ("[0, 0, 0]", "[0, -0.7, 0]"):
        scenario = uv.load_scenario("girona500_ideal", [f"task.frame={frame}"])
        basis_of(scenario, uv.load_model(scenario), ("J_max",))
    assert keys[0] != keys[1]
