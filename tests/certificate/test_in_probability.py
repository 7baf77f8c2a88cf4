"""Tests of the certificate in probability: data, wording, ranges, staleness."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support.probability import NAME, RANGES, made
from uvms_drake.certificate.drawn_values import drawn_values, outside_ranges
from uvms_drake.tube.coupled.budget import CoupledBudget, Source, Stage

from uvms_drake.campaign.probability.declared_distribution import declared_ranges
from uvms_drake.certificate.certificate import (
    CERTIFICATE_FILE,
    Certificate,
    fingerprint,
    read_certificate,
    stale_reason,
    write_certificate,
)
from uvms_drake.certificate.in_probability import ProbabilityCertificate, read_any_certificate
from uvms_drake.certificate.probability_table import format_probability, sentences
from uvms_drake.command.run import sound
from uvms_drake.common.errors import RunFailed
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import load_scenario


def test_the_verdict_is_its_exact_sentence():
    assert made().verdict == (
        "certified in probability: at most 4.87 % per run at 95 % confidence, for the declared "
        "distribution")


def test_the_verdict_of_a_mission_names_its_steps():
    of_mission = made(mission="approach, slide, retreat")
    assert of_mission.verdict == (
        "certified in probability: at most 4.87 % per run at 95 % confidence, for the declared "
        "distribution of the mission approach, slide, retreat")
    assert "or did not complete a step of its mission." in sentences(of_mission)[-1]
    assert "mission" not in " ".join(sentences(made()))
    assert ProbabilityCertificate.from_data(
        json.loads(json.dumps(of_mission.to_data()))) == of_mission


def test_every_part_is_one_sentence_and_no_word_claims_more():
    for certificate in (made(), made((2, 7, 9), p=0.123)):
        text = format_probability(certificate)
        assert "proven" not in text
        assert text.count("certified") == text.count("certified in probability") == 1
        for sentence in sentences(certificate):
            assert sentence.endswith(".")
            assert sentence.count(". ") == 0
        assert "start: anywhere" in text


def test_the_linear_budget_stands_beside_it_and_goes_through_a_file():
    ones = np.ones(11)
    rows = ("depth", "tip y", "tip z", "vehicle x", "roll", "pitch", "q1", "q2", "q3",
            "depth speed", "q1 rate")
    sources = (Source("noise", 9.0 * ones, 3.0 * ones, True),)
    budget = CoupledBudget(rows, (Stage("press", sources, ones),), 1e-3, 6.0, 2, {"depth": 0.03},
                           {"depth": 0.02}, (), 0.05)
    certificate = made(coupled=budget)
    restored = ProbabilityCertificate.from_data(json.loads(json.dumps(certificate.to_data())))
    (stage,), (known,) = restored.coupled.stages, budget.stages
    np.testing.assert_array_equal(restored.coupled.by_chance(stage), budget.by_chance(known))
    assert restored.to_data() == certificate.to_data()
    text = format_probability(restored)
    assert text.startswith(format_probability(made()))
    assert "noise, σ" in text and "it is no proof" in text


def test_failures_are_told_by_number_and_kind():
    assert sentences(made())[0] == "0 of 60 runs failed."
    count, bound, *_ = sentences(made((2, 7, 9), p=0.123))
    assert count == "3 of 60 runs failed (2, 7, 9): 3 left the declared tube."
    assert "at most 12.3 %, unless these 60 runs were an event of probability 5 % or less" in bound


def test_the_distance_from_the_linear_loop_is_told_where_it_was_looked_at():
    assert "No run was compared with its coupled linear loop." in sentences(made())
    assert "linear loop" not in sentences(made())[-1]
    compared = made(apart={"tip": 0.341, "joints": 0.52})
    *_, distance, failure = sentences(compared)
    assert distance == ("The largest distance of a run from its coupled linear loop, given its "
                        "noise, plan, touch and friction, is 0.34 of the line of the tip and 0.52 "
                        "of the line of the joints.")
    assert failure.endswith("or left a declared line about its coupled linear loop.")


def test_the_used_part_of_the_class_of_plans_is_told_where_there_is_one():
    assert "class of plans" not in " ".join(sentences(made()))
    planned = made(plan={"approach": 0.561, "press": 0.6, "start": 0.8})
    *_, used, failure = sentences(planned)
    assert used == ("Of the declared class of plans the runs used 0.56 in the approach, 0.6 in the "
                    "press and 0.8 at the start.")
    assert failure.endswith("or had a plan or a start outside of the declared class.")
    restored = ProbabilityCertificate.from_data(json.loads(json.dumps(planned.to_data())))
    assert restored == planned


def test_it_is_written_and_read_and_its_kind_is_told(tmp_path):
    certificate = made((1,))
    write_certificate(certificate, tmp_path)
    data = json.loads((tmp_path / CERTIFICATE_FILE).read_text("utf-8"))
    assert {"kind", "runs", "failures", "confidence", "probability", "distribution", "ranges",
            "source", "sha256"} <= data.keys()
    assert data["kind"] == "in probability"
    assert "certified" not in data
    assert read_any_certificate(tmp_path / CERTIFICATE_FILE) == certificate
    with pytest.raises(RunFailed, match="a certificate in probability, none for the worst case"):
        read_certificate(tmp_path / CERTIFICATE_FILE)
    (tmp_path / CERTIFICATE_FILE).write_text(json.dumps(data | {"failures": 0}), encoding="utf-8")
    with pytest.raises(RunFailed, match="SHA-256"):
        read_any_certificate(tmp_path / CERTIFICATE_FILE)


def test_a_worst_case_certificate_tells_its_kind_too(tmp_path):
    scenario = load_scenario("girona500_ideal")
    write_certificate(Certificate(
        scenario=scenario.name, law="resolved", k=1.0, sigma=1.0, d_bound=0.1,
        **fingerprint(scenario)), tmp_path)
    assert '"kind": "worst case"' in (tmp_path / CERTIFICATE_FILE).read_text("utf-8")
    assert isinstance(read_any_certificate(tmp_path / CERTIFICATE_FILE), Certificate)


@pytest.mark.parametrize(("change", "reason"), [
    ("seed=4", None), ("current=[0.0, 0.05, 0.0]", None), ("model_error.mass=0.95", None),
    ("surface.friction=0.4", None), ("surface.geometry.point=[0.1, 0.0, 0.0]", None),
    ("start.eta=[-1.41, -0.11, -0.12, 0.03, 0.04, 0.02]", None), ("duration=40", None),
    ("task.force=[15.0, 0.0, 0.0, 0.0, 0.0, 0.0]", None), ("log_period=0.1", "the scenario"),
    ("current=[0.0, 0.3, 0.0]", None),  # Drawn, though it is out of its range.
    ("ancillary.tip.k=19", "the scenario"), ("tube.z=0.4", "the scenario"),
    ("contact.friction=0.4", "the scenario"), ("mpc.hover=3", "the scenario"),
    ("disturbance.bound=0.01", "the scenario")])
def test_only_a_change_of_drawn_values_leaves_it_fresh(change, reason):
    assert stale_reason(made(), load_scenario(NAME, [change])) == reason


def test_another_program_makes_it_stale():
    assert stale_reason(made(source="another"), load_scenario(NAME)) == "this package"
    versions = {"uvms_drake": "0", "drake": "0"}
    assert stale_reason(made(versions=versions), load_scenario(NAME)) == "a version"


@pytest.mark.parametrize(("change", "phrase"), [
    ("current=[0.0, 0.3, 0.0]", "current, horizontal is 0.3, declared from 0 to 0.1 m/s"),
    ("model_error.mass=1.2", "model_error.mass is 1.2, declared from 0.9 to 1.1"),
    ("surface.friction=0.6", "wall, friction is 0.6, declared from 0 to 0.5"),
    ("task.force=[40.0, 0.0, 0.0, 0.0, 0.0, 0.0]", "task.force is 40, declared from 5 to 30 N"),
    ("seed=9", None)])
def test_a_value_out_of_its_range_is_told(change, phrase):
    scenario = load_scenario(NAME, [change])
    found = made().outside(drawn_values(scenario, load_model(scenario)))
    assert found == ([] if phrase is None else [phrase])


def test_the_values_of_the_wall_are_those_where_the_tip_faces_it():
    scenario = load_scenario(NAME)
    values = drawn_values(scenario, load_model(scenario))
    assert values["wall, angle"] == pytest.approx(0.05236, abs=1e-4)  # 3 degrees.
    assert values["wall, distance"] == pytest.approx(0.4, abs=0.05)
    assert values["wall, largest stiffness"] == values["wall, smallest stiffness"] == 700.0
    assert not outside_ranges([replace(RANGES[0], high=0.1)], values)


def test_a_run_with_faults_of_its_own_is_none_of_the_drawn_ones():
    faulty = load_scenario(NAME, ["faults=[!SolverFailure {probability: 1.0}]"])
    assert ProbabilityCertificate.inputs_of(faulty)["inputs"] != made().inputs


@pytest.mark.parametrize(("override", "said"), [
    ("surface=!UnilateralPlane {stiffness: 1000000.0}", "wall, friction is not defined"),
    ("surface.creep=0.0002", "wall, reciprocal of the creep is 5000, declared from 0 to 200 s/m"),
    ("surface.law.transition=0.1", "wall, transition is 0.1, declared from 0.001 to 0.005 m")])
def test_a_wall_that_is_never_drawn_is_outside(override, said):
    base, wall = load_scenario(NAME), load_scenario(NAME, [override])
    ranges = list(declared_ranges(base))
    assert not outside_ranges(ranges, drawn_values(base, load_model(base)))
    outside = outside_ranges(ranges, drawn_values(wall, load_model(wall)))
    assert any(said in each for each in outside)


def test_nothing_is_certified_if_every_run_failed():
    certificate = made((0, 1), runs=2, p=1.0)
    assert not certificate.holds
    assert certificate.verdict == "not certified in probability: every run failed"
    with pytest.raises(RunFailed, match=f"^{NAME}: not certified in probability"):
        sound(certificate, NAME)
