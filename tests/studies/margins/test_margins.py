"""Tests of `uvms_drake.studies.margins.margins`."""

import json
import math
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from support.quick import FEW, search_less

from uvms_drake.certificate.certificate import Certificate, fingerprint
from uvms_drake.certificate.certify import basis_of, certify
from uvms_drake.certificate.declared_unknowns import (
    RESERVED,
    UnknownEffect,
    UnmodelledBounds,
    declared_sources,
    unknown_effects,
    weights_of,
)
from uvms_drake.command.main import main
from uvms_drake.common.errors import InvalidParameter
from uvms_drake.sensing import ForceSensor
from uvms_drake.station.contact.bounds import largest_reading_error
from uvms_drake.station.contact.parameters import Parameter
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.studies.margins import margins as study
from uvms_drake.studies.margins.margin import FARTHEST, FINE, Margin, tube_of
from uvms_drake.studies.margins.margins import format_margins, margins
from uvms_drake.studies.margins.unknown_margins import Study, Unknown, unknowns
from uvms_drake.tube.conditions import Condition, assumption
from uvms_drake.tube.search.search_memo import SearchMemo


@pytest.fixture(scope="module")
def felt():
    return load_scenario("girona500_contact", FEW)


def value_of(today: float, start: float = 0.0):
    return Parameter("lag", "s", today, lambda value: value, start)


def ends_at(limit: float):
    """Returns what fails of a value beyond a limit."""
    def failed(parameter, size, searches):
        value = parameter.at(size)
        return Condition("room", value, "<=", limit, theorem="t") if value > limit else None

    return failed


@pytest.mark.parametrize(("today", "limit"), [(0.02, 0.0201), (0.02, 0.11), (3.0, 100.0)])
def test_the_largest_value_is_bracketed(today, limit, monkeypatch):
    monkeypatch.setattr(study, "_worst_failed", ends_at(limit))
    found = study._margin(value_of(today), SearchMemo())
    assert limit / FINE <= found.largest <= limit
    assert (found.today, found.ends) == (today, "room")


def test_nobody_looks_beyond_what_is_far_enough(monkeypatch):
    monkeypatch.setattr(study, "_worst_failed", ends_at(1e9))
    found = study._margin(value_of(2.0), SearchMemo())
    assert (found.largest, found.ends) == (2.0 * FARTHEST, "")


def test_what_is_void_at_any_value_says_so_and_what_is_too_large_at_the_least_is_zero(monkeypatch):
    void = assumption("actuation[0]", "the proofs take the feedback for continuous", theorem="t")
    monkeypatch.setattr(study, "_worst_failed", lambda value, size, searches: void)
    found = study._margin(value_of(0.0, 1e-3), SearchMemo())
    assert math.isnan(found.largest)
    assert found.ends == void.name
    monkeypatch.setattr(study, "_worst_failed", ends_at(1e-4))
    assert study._margin(value_of(0.0, 1e-3), SearchMemo()).largest == 0.0


def test_a_value_without_a_meaning_ends_it():
    def at(value):
        raise InvalidParameter("contact.angle", value, "from 0 to 0.5 rad")

    assert "contact.angle" in study._worst_failed(
        replace(value_of(0.0), at=at), 0.6, SearchMemo()).name


def test_clock_thrusters_and_navigation_are_put_where_they_belong(felt):
    """And none is certified: the conditions are those of the parts themselves."""
    for value, kinds in zip(study._delays(felt, load_model(felt)), (
            ["SampledCommand", "IdealWrench"], ["SampledCommand", "IdealWrench"],
            ["Thrusters"], ["IdealWrench"]), strict=True):
        changed = value.at(value.start)
        assert [type(part).__name__ for part in changed.actuation] == kinds
        failed = study._worst_failed(value, value.start, SearchMemo())
        assert failed is not None
        assert failed.is_count
    both = load_scenario("girona500_real_loop")
    period, delay, lag, noise = study._delays(both, load_model(both))
    assert period.today == 0.02
    assert [type(part).__name__ for part in lag.at(0.3).actuation] == [
        "SampledCommand", "Thrusters"]
    assert lag.at(0.3).actuation[1].lag == 0.3
    assert delay.at(0.004).actuation[0].delay == 0.004
    assert period.at(0.03).actuation[0].period == pytest.approx(0.2 / 7), "a knot is a tick"
    assert period.tried(0.03) == pytest.approx(0.2 / 7), "and that is what is told"
    with pytest.raises(InvalidParameter, match=r"at most mpc\.time_step"):
        period.at(0.3)
    assert np.all(noise.at(0.01).sensing[0].dvl.noise == 0.01)


def test_a_worse_sensor_comes_with_the_allowance_that_it_needs(felt):
    noise = next(value for value in felt.contact.parameters(felt) if "noise" in value.name)
    assert noise.today == 0.25
    changed = noise.at(1.0)
    assert np.all(changed.sensing[0].noise == 4.0 * ForceSensor().noise)
    need, now = (largest_reading_error(each, each.contact.force_bounds(each), 1.0)
                 for each in (changed, felt))
    more = changed.contact.force_error - felt.contact.force_error
    assert more == pytest.approx(need - now) and more > 1.0
    assert noise.at(noise.today).contact.force_error == felt.contact.force_error
    exact = replace(felt, sensing=[replace(felt.sensing[0], noise=np.zeros(6))])
    none = next(value for value in exact.contact.parameters(exact) if "noise" in value.name)
    assert (none.today, none.start) == (0.0, 1e-3)
    np.testing.assert_allclose(none.at(0.25).sensing[0].noise, ForceSensor().noise)
    slow = next(value for value in felt.contact.parameters(felt) if "lag" in value.name).at(0.05)
    assert slow.contact.delay == pytest.approx(5.0 * 0.05 + 0.01)


class BoundedStudy:
    """A study of a scenario that is its unknown, of which d = size (1 + size) must have room."""

    scenario = None

    def __init__(self, room: float):
        self._room = room

    def effects(self, size):
        return (UnknownEffect("current", (size * (1.0 + size),) * 2, 1.5 * size, math.nan),)

    def fitted(self, size, sources, searches):
        needed = 1.5 * size * (1.0 + size)
        failed = None if needed <= self._room else Condition(
            "room", needed, "<=", self._room, theorem="t")
        return SimpleNamespace(model_error=size, disturbance=None, contact=None), failed


@pytest.fixture
def unknown(monkeypatch):
    monkeypatch.setattr("uvms_drake.studies.margins.unknown_margins.settings_of",
                        lambda size, *_: str(size))
    return lambda most=math.inf: Unknown(
        "current", "m/s", 0.25, lambda size: size, lambda size: size, most=most)


@pytest.mark.parametrize("room", [0.02, 0.09, 3.0])
def test_the_size_of_an_error_is_that_of_which_all_d_has_room(room, unknown):
    found = unknown().margin(BoundedStudy(room))
    exact = (math.sqrt(1.0 + 4.0 * room / 1.5) - 1.0) / 2.0
    assert exact / FINE <= found.largest <= exact
    assert found.ends == "room"
    assert float(found.settings) == found.largest
    assert found.d == pytest.approx((0.3125, 0.3125))


def test_an_error_ends_where_it_has_no_meaning_or_has_no_room_at_all(unknown):
    bounded = unknown(most=0.8).margin(BoundedStudy(1e3))
    assert 0.8 / FINE <= bounded.largest <= 0.8
    none = unknown().margin(BoundedStudy(1e-9))
    assert (none.largest, none.ends, none.settings) == (0.0, "room", "")


def test_every_unknown_but_the_wrench_is_declared_by_a_scenario():
    for each in unknowns():
        assert each.declared(0.5 * each.asked).present == ("wrench" not in each.name)
    wave = next(each for each in unknowns() if "waves" in each.name)
    assert wave.declared(0.2).waves[0].speeds == pytest.approx((0.2, 0.2))


def test_the_command_prints_them_and_writes_them_down(felt, tmp_path, monkeypatch, capsys):
    """Of a certificate that holds; of one that is void there are none."""
    certificate = Certificate(
        scenario="girona500_contact", motion="dynamic", law="resolved", k=50.0, sigma=50.0,
        d_bound=0.1, conditions=(Condition("room", 1.0, "<", 2.0, theorem="t"),),
        **fingerprint(felt))
    found = [Margin("force sensor, lag", "s", 0.02, 0.033, "room"),
             Margin("feedback, period", "s", 0.0, math.nan, "the proofs take it for continuous"),
             Margin("current", "m/s", 0.0, 0.1, "room", (0.2,) * 7, 0.25, "--set a=1")]
    monkeypatch.setattr("uvms_drake.certificate.certify.certified_once", lambda *_: certificate)
    monkeypatch.setattr("uvms_drake.studies.margins.margins.margins", lambda *_, **__: found)
    command = ["certify", "girona500_contact", "--tolerances", f"--output={tmp_path / 'out'}"]
    assert main(command) == 0
    printed = capsys.readouterr().out
    assert "force sensor, lag" in printed
    assert "--set a=1" in printed
    lag, period, current = json.loads((tmp_path / "out" / "tolerances.json").read_text())
    assert (lag["today"], lag["largest"], lag["ends"]) == (0.02, 0.033, "room")
    assert period["largest"] is None
    assert current["settings"] == "--set a=1"
    void = replace(certificate, conditions=(Condition("room", 3.0, "<", 2.0, theorem="t"),))
    monkeypatch.setattr("uvms_drake.certificate.certify.certified_once", lambda *_: void)
    assert main(command) == 1
    assert "no tolerances: the scenario is not certified" in capsys.readouterr().out
    assert not (tmp_path / "out" / "tolerances.json").exists(), "those of another certificate"


@pytest.mark.slow
def test_a_current_with_the_settings_of_the_study_is_certified(felt, monkeypatch):
    """The study and the certificate fit the same disturbance."""
    search_less(monkeypatch)
    study = Study(felt, load_model(felt))
    current = next(each for each in unknowns() if each.name == "current")
    scenario, failed = study.fitted(current.declared(0.1), current.sources(0.1), SearchMemo())
    assert failed is None
    certificate = certify(replace(scenario, mpc=replace(scenario.mpc, horizon=23)))
    assert certificate.certified, [str(each) for each in certificate.conditions if not each.holds]
    (effect,) = certificate.unknowns
    assert effect.name == "a current of 0.1 m/s"
    assert effect.takes == pytest.approx(RESERVED * scenario.disturbance.bound, rel=0.03)


@pytest.mark.long
@pytest.mark.slow
def test_nearly_the_tolerance_of_a_current_is_certified():
    """The tolerance is between the second and the third; the first is 10 % less."""
    scenario = load_scenario("girona500_contact")
    study, searches = Study(scenario, load_model(scenario)), SearchMemo()
    current = next(each for each in unknowns() if each.name == "current")
    scenarios, failed = zip(*(study.fitted(
        current.declared(size), current.sources(size), searches)
        for size in (0.113, 0.125, 0.135)), strict=True)
    assert [each is None for each in failed] == [True, True, False]
    certificate = certify(replace(scenarios[0], mpc=replace(scenarios[0].mpc, horizon=35)))
    assert certificate.certified, [str(each) for each in certificate.conditions if not each.holds]


@pytest.mark.long
def test_what_is_found_is_certified_and_what_is_beyond_is_not(felt, monkeypatch):
    """The bound of d, by searches made anew; and each of the tables has its rows."""
    search_less(monkeypatch)
    found = margins(felt, load_model(felt))
    bound = found[0].largest
    for factor, holds in ((0.97, True), (1.05, False)):
        at = replace(felt, disturbance=replace(felt.disturbance, bound=factor * bound))
        model = load_model(at)
        _, conditions = tube_of(at, model, basis_of(at, model))
        assert all(condition.holds for condition in conditions) == holds
    text = format_margins(found)
    for name in ("force sensor, lag", "thrusters, lag", "mass of all bodies", "current"):
        assert name in text
    by_name = {each.name: each for each in found}
    assert by_name["wall and tool, stiffness"].largest > 1000.0
    still = by_name["current"]
    assert 0.0 < still.largest < 1.0
    # With the settings that are printed, its effect and all limits have room.
    declared = load_scenario("girona500_contact", [
        *FEW, f"current=[0, {still.largest}, 0]", *still.settings.replace("--set ", "").split()])
    model = load_model(declared)
    radii, conditions = tube_of(declared, model, basis_of(declared, model))
    assert all(condition.holds for condition in conditions)
    basis = basis_of(declared, model)
    effects = unknown_effects(
        partial(declared_sources, declared.unknowns),
        UnmodelledBounds(declared.model, basis, radii, declared.seed),
        weights_of(declared.disturbance, basis))
    assert sum(each.takes for each in effects) <= 1.02 * RESERVED * declared.disturbance.bound
