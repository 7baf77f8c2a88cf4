"""Tests of `uvms_drake.setup.calibrate`: tube and gains of a real loop from pilot runs."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.refusals import refusals
from support.synthetic import synthetic_sensed_record

import uvms_drake as uv
from uvms_drake.campaign.pool import local_pool
from uvms_drake.command.main import main
from uvms_drake.common.errors import InvalidParameter, RunFailed
from uvms_drake.common.progress import silent
from uvms_drake.report.tube_use import deviations, tube_use
from uvms_drake.setup import calibrate as module
from uvms_drake.setup.calibrate import (
    Calibration,
    Row,
    available_radii,
    best_gains,
    check_real,
    fitting,
    other_failures,
    radii_by_row,
    slowed,
    tube_of,
    with_gains,
    with_totals,
)
from uvms_drake.setup.calibrated_file import calibrated_text
from uvms_drake.station.scenario.scenario import dump_scenario
from uvms_drake.station.scenario.scenario_file import scenario_path

REAL = "girona500_real_loop"
FINE = {"error": None, "finite": True, "exits_set": 0, "exits_trajectory": 0, "violations": 0,
        "limited": False, "mpc_failures": 0, "losses": 0, "touched": True, "off_line": 0.4,
        "starts": 2}
ROOM = {"position": 0.02, "depth": 0.005, "nu1": 0.25, "qdot": 1.0, "e": np.inf}


@pytest.fixture(scope="module")
def real():
    return uv.load_scenario(REAL)


@pytest.fixture(scope="module")
def model(real):
    return uv.load_model(real)


@pytest.fixture
def fits(monkeypatch):
    """Replaces the search for a plan: a tube fits if its depth is less than 4 mm."""
    def derived(scenario, model, tube):
        if tube.depth >= 0.004:
            raise InvalidParameter("draws.force", 20.0, "below 18 N")
        return scenario

    monkeypatch.setattr(module, "derived", derived)


@pytest.mark.parametrize(("hover", "longer"), [(4.0, 4.0), (8.0, 0.0), (9.6, 0.0)])
def test_a_longer_hover_makes_the_run_longer(real, model, hover, longer):
    now = module.derived(replace(real, mpc=replace(real.mpc, hover=hover)), model, real.tube)
    assert now.mpc.hover == pytest.approx(8.0)
    assert now.duration - real.duration == pytest.approx(longer)


def rows_of(**largest: float) -> dict[str, Row]:
    return {name: Row(largest.get(name, 0.001), 0.01, most) for name, most in ROOM.items()}


@pytest.mark.parametrize(("largest", "radius"), [
    (0.001, 0.003),   # 3 M, far from its limit
    (0.0025, 0.006),  # s L
    (0.004, 0.008)])  # 2 M
def test_a_radius_is_twice_the_largest_deviation_or_fills_what_the_limit_leaves(
        fits, largest, radius):
    tube, multiple = fitting(None, None, rows_of(position=largest), grow=False)
    assert multiple == 2.0
    assert tube.position == pytest.approx(radius)
    assert tube.e == pytest.approx(0.003)  # No limit is about it.


def test_in_a_further_round_no_radius_gets_smaller(fits):
    tube, _ = fitting(None, None, rows_of(nu1=0.007, depth=0.001) | {
        "depth": Row(0.001, 0.0021, 0.005)}, grow=True)
    assert (tube.nu1, tube.position, tube.depth) == pytest.approx((0.014, 0.01, 0.0021))


def test_what_does_not_fit_has_a_smaller_multiple_and_below_one_and_a_half_the_limit_is_named(fits):
    tube, multiple = fitting(None, None, rows_of(depth=0.0023), grow=False)
    assert 0.0037 < tube.depth < 0.004
    assert multiple == pytest.approx(tube.depth / 0.0023, rel=0.01)
    with pytest.raises(RunFailed, match=r"depth takes 93% of its limit; draws\.force = 20\.0"):
        fitting(None, None, rows_of(depth=0.0031), grow=False)


def test_the_gains_are_of_the_delays_of_wrench_and_joints(real, model):
    """T = 0.15 + 0.05 + 0.01 + 0.01 + 0.005 s of a wrench, 0.02 s of a torque and of a reading."""
    law = with_gains(real, 0.22, model).ancillary
    sigma = 1.5 * 0.22 / np.array([0.225, 0.04])
    for block, expected in zip((law.vehicle, law.tip), sigma, strict=True):
        assert [block.k, block.sigma, block.observer] == pytest.approx(
            expected * np.array([2.0, 1.0, 0.6]), rel=0.05)


def test_the_gains_are_tried_with_delays_that_are_half_as_long_again(real, model):
    clock, thrusters = slowed(real, model).actuation
    assert (clock.delay, clock.period) == (pytest.approx(0.015), 0.02)
    assert (thrusters.lag, thrusters.dead_time) == pytest.approx((0.225, 0.08))  # Of whole periods.


def test_the_room_of_a_row_is_that_of_its_tightest_limit(real, model):
    available = available_radii(real, model)
    assert available["nu1"] == real.limits.nu1
    assert available["u_roll"] == real.limits.u[3]
    angle = real.contact.tool_angle  # Its limit is of the cosine.
    assert available["orientation"] == pytest.approx(np.tan(0.5 * angle) / np.sqrt(2.0))
    assert available["joints"] == pytest.approx(0.5 * np.min(
        np.subtract(real.limits.q_upper, real.limits.q_lower)))
    assert np.isinf(available["e"])
    # With all of it no more than the largest drawn force is left of the safe region.
    tube = tube_of({**dict.fromkeys(radii_by_row(real.tube), 0.0), "depth": available["depth"]})
    assert module.largest_force(replace(real, tube=tube)) == pytest.approx(real.draws.force[1])


@pytest.mark.parametrize("name", [REAL, "bluerov2_real_loop"])
def test_the_rows_are_those_whose_use_a_run_reports(name, monkeypatch):
    """Of a record without a simulation, with tau where it is limited."""
    scenario = uv.load_scenario(name)
    available = available_radii(scenario, uv.load_model(scenario))
    tube = tube_of(dict.fromkeys(available, 0.01))
    record = replace(synthetic_sensed_record(12.0), scenario=replace(scenario, tube=tube))
    result = FINE | {"index": 0, "use": tube_use(record)}
    assert set(result["use"]) == set(radii_by_row(tube)) == set(available)
    monkeypatch.setattr(module._Pilots, "results", lambda *_: [result])
    largest, _ = module._Pilots(scenario, 1, local_pool()).largest(record.scenario, silent)
    late = record.time >= scenario.mpc.hover
    for key in ("u_roll", "depth"):
        assert largest[key] == pytest.approx(np.max(deviations(record)[key][late]))


def test_totals_are_norms_of_their_blocks():
    radii = with_totals({"position": 3.0, "orientation": 4.0, "joints": 12.0, "nu1": 1.0,
                         "nu2": 2.0, "qdot": 2.0})
    assert (radii["e"], radii["z"]) == (13.0, 3.0)


def test_failures_that_a_radius_explains_are_none_and_others_have_a_size():
    fine = {"error": None, "finite": True, "exits_set": 3, "exits_trajectory": 0, "use": {"e": 1.2},
            "violations": 1, "limited": False, "mpc_failures": 0, "losses": 0, "touched": True,
            "off_line": 0.4}
    assert other_failures(fine) == []
    assert other_failures(fine | {"off_line": 1.29, "touched": False}) == [
        "never touched the wall",
        "pressed off the desired force by more than the force line at the end of a hold (1.29 of "
        "it)"]


test_what_is_no_real_loop_or_lacks_a_number_is_refused = refusals(REAL, {
    "contact=!KnownSurface {}; limits.static_force=45; surface=!UnilateralPlane {}":
        "contact.*a !SensedContact",
    "sensing=[!ForceSensor {}]": "sensing.*with a !Navigation",
    "actuation=[!SampledCommand {}]": "actuation.*with a !Thrusters",
    "ancillary=!Resolved {k: 5, sigma: 2}": "ancillary.*a !TipFirst",
    "draws.speed=null": r"draws\.speed.*declared",
    "draws.force=null": r"draws\.force.*declared",
    "contact.tangential_lag=0": r"contact\.tangential_lag.*positive",
    "draws.force=[5, 500]": r"draws\.force = 500\.0.*along surge .* more than there is",
    "mission.steps=[!Approach {}, !Hold {force: 500}, !Retreat {}]":
        r"mission\.steps\[1\]\.force = 500\.0.*along surge",
}, check_real)


@pytest.mark.parametrize("scale", [None, 0.22])
def test_a_calibrated_file_has_the_numbers_their_origin_and_is_calibrated_to_itself(
        real, tmp_path, scale):
    rows = {name: Row(0.4 * radius, radius, 4.0 * radius)
            for name, radius in radii_by_row(real.tube).items()}
    changed = replace(real, duration=70.5,
                      mpc=replace(real.mpc, hover=3.4, terminal_radius=0.051))
    found = Calibration(changed, rows, 20, 2.0, 2, scale, 0.2, 1.5)
    text = calibrated_text(scenario_path(REAL).read_text("utf-8"), found, "uvms-drake calibrate")
    file = tmp_path / "again.yaml"
    file.write_text(text, encoding="utf-8")
    loaded = uv.load_scenario(str(file))
    assert radii_by_row(loaded.tube) == radii_by_row(real.tube)
    assert (loaded.duration, loaded.mpc.hover, loaded.mpc.terminal_radius) == (70.5, 3.4, 0.051)
    assert loaded.ancillary == real.ancillary
    tube = text[text.index("\ntube:"):]
    assert re.search(r"position: 0\.00775 +# m \(0\.0031; 25%\)", tube)
    assert re.search(r"depth: 0\.00306 +# m \(0\.0012; 25%\)", tube)
    # A deviation for each input.
    assert re.search(r"# \([\d.]+(, [\d.]+){9}\)\n  u: \[.*\] # m/s2 \(3\), rad/s2\n", tube)
    assert len(re.findall(r"^tube:", text, re.M)) == 1
    assert calibrated_text(text, found, "uvms-drake calibrate") == text
    assert text.startswith(scenario_path(REAL).read_text("utf-8")[:300])


def test_a_calibrated_file_keeps_what_stands_after_its_tube(real):
    rows = {name: Row(0.4 * radius, radius, 4.0 * radius)
            for name, radius in radii_by_row(real.tube).items()}
    found = Calibration(real, rows, 20, 2.0, 2, None, 0.2)
    text = calibrated_text("a: 1\ntube:\n  # of pilots\n\n  e: 1.0\n# of the maker\nlimits: 2\n"
                           "mpc:\n  hover: 3.0", found, "x")
    assert text.startswith("a: 1\n# of the maker\nlimits: 2\nmpc:\n")
    assert "of pilots" not in text and text.count("tube:") == 1


def test_a_layout_that_takes_no_numbers_is_refused_before_the_pilot_runs(
        tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "mine.yaml"
    file.write_text(f"base: {REAL}\nmpc: {{hover: 4.0}}\n", "utf-8")
    assert main(["calibrate", str(file), "--quiet"]) == 2
    err = capsys.readouterr().err
    assert "mine_calibrated.yaml" in err and err.count("\n") == 1
    assert list(tmp_path.iterdir()) == [file]


def test_the_table_has_every_row_and_the_share_of_redrawn_starts(real):
    rows = {"nu1": Row(0.011, 0.022, 0.25), "e": Row(0.05, 0.1, np.inf)}
    text = str(Calibration(real, rows, 20, 2.0, 2, None, 0.25))
    assert re.search(r"nu1 +0\.011 +0\.022 +9%", text)
    assert "of the starts 25% had no first plan" in text


def test_without_a_limit_of_the_forces_the_tube_of_the_base_has_none_either(real):
    bare = replace(real, tube=replace(real.tube, tau=None))
    found = Calibration(bare, {}, 20, 2.0, 2, None, 0.2)
    text = calibrated_text("base: bluerov2_real_loop\n", found)
    assert re.search(r"^  tau: null +# as `limits.tau`$", text, re.M)


def test_what_no_run_can_be_repeated_with_is_refused_before_the_pilot_runs(
        tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("uvms_drake.command.drawn_runs.calibrate", lambda *_: pytest.fail("runs"))
    (tmp_path / "mine.yaml").write_text(f"base: {REAL}\nmpc: {{deadline: 0.1}}\n", "utf-8")
    assert main(["calibrate", "mine.yaml", "--quiet"]) == 2
    assert "mpc.deadline = 0.1" in capsys.readouterr().err


@pytest.mark.parametrize(("scores", "best"), [
    ([3.0, 1.2, 1.0, 0.9, 0.8], 0.45), ([1.0, 0.9, 0.8, 3.0, 3.0], 0.16), ([3.0] * 5, None)])
def test_a_scale_that_is_too_soft_is_no_border_of_stability(real, model, monkeypatch, scores, best):
    """From a scale that fails at least 1.5 times lower, but not from one below all that work."""
    available = dict.fromkeys(radii_by_row(real.tube), 1.0)
    radius = real.tube.nu1
    monkeypatch.setattr(module, "derived", lambda scenario, *_: scenario)
    monkeypatch.setattr(module._Pilots, "results", lambda *_: [
        FINE | {"index": 0, "use": {"nu1": score / (1.5 * radius)}} for score in scores])
    pilots = module._Pilots(real, 1, local_pool())
    if best is None:
        with pytest.raises(RunFailed, match="no gains, by scale"):
            module.best_gains(real, model, available, pilots, silent)
    else:
        assert module.best_gains(real, model, available, pilots, silent)[0] == best


@pytest.mark.parametrize(("options", "said"), [
    (["--runs", "0"], "--runs = 0: must be at least 1"), (["--output", "a.txt"], "a .yaml file")])
def test_bad_options_are_one_line(options, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", REAL, *options]) == 2
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == 1
    assert not list(tmp_path.iterdir())


class Drawn:
    """Results of pilot runs that are not simulated: a share of each limit, off by a tenth."""

    def __init__(self, monkeypatch, shares: dict[str, float], **failed):
        self.rounds, self.shares, self.failed = list[uv.Scenario](), shares, failed
        monkeypatch.setattr(module._Pilots, "results", lambda _, *args: self.results(*args))

    def results(self, scenarios, number, progress):
        """Returns the results, of which the last has the failures."""
        scenario, = scenarios
        self.rounds.append(scenario)
        available = available_radii(scenario, uv.load_model(scenario))
        largest = {name: self.shares.get(name, 0.02) * min(most, 10.0)
                   for name, most in available.items()}
        return [FINE | {"index": i, "use": {
            name: (0.9 + 0.1 * (i == 1)) * largest[name] / radius
            for name, radius in radii_by_row(scenario.tube).items()}}
            | (self.failed if i == number - 1 else {}) for i in range(number)]


def test_the_gains_are_the_best_well_below_those_that_fail(real, model, monkeypatch):
    """The fourth of five is best, but less than 1.5 times smaller than the one that fails."""
    pilots, available = module._Pilots(real, 1, local_pool()), available_radii(real, model)
    tried = list[uv.Scenario]()

    def results(scenarios, number, progress):
        tried.extend(scenarios)
        return [FINE | {"use": {"nu1": use / module.SLOWER * available["nu1"] / each.tube.nu1}}
                | ({"off_line": 2.0} if use > 1.0 else {})
                for use, each in zip((0.5, 0.4, 0.45, 0.2, 1.1), scenarios, strict=True)]

    monkeypatch.setattr(pilots, "results", results)
    monkeypatch.setattr(module, "derived", lambda scenario, model, tube: scenario)
    scale, found = best_gains(real, model, available, pilots, silent)
    assert scale == module.SCALES[1]
    ratios = [each.ancillary.vehicle.k / found.ancillary.vehicle.k for each in tried]
    assert ratios == pytest.approx([each / scale for each in module.SCALES], rel=0.03)
    # Delays of the clock and the thrusters are longer in these runs, and not in what is found.
    assert tried[0].actuation[0].delay == pytest.approx(1.5 * real.actuation[0].delay)
    assert found.actuation == real.actuation


@pytest.mark.long
def test_the_command_writes_a_scenario_that_a_certificate_in_probability_takes(
        monkeypatch, tmp_path, capsys):
    """Of nu1 0.12 of its limit, so that 0.3 of the limit is between twice and thrice that."""
    pilots = Drawn(monkeypatch, {"depth": 0.3, "u_roll": 0.2, "nu1": 0.12})
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", REAL, "--runs", "3", "--quiet"]) == 0
    out = capsys.readouterr().out
    found = uv.load_scenario(str(tmp_path / f"{REAL}_calibrated.yaml"))
    assert len(pilots.rounds) == 2
    assert dump_scenario(replace(pilots.rounds[1], name="")) == dump_scenario(
        replace(found, name=""))
    assert found.tube.nu1 == pytest.approx(0.3 * 0.25, rel=0.01)
    assert found.contact.speed == pytest.approx(0.065 + found.tube.depth_speed, rel=0.01)
    assert found.mpc.hover == 8.0  # Five time constants of the slower observer, of 0.64 1/s.
    text = (tmp_path / f"{REAL}_calibrated.yaml").read_text("utf-8")
    assert f"by `uvms-drake calibrate {REAL} --runs 3`" in text
    assert "of the starts 50% had no first plan" in out and re.search(r"u_roll +0\.14 ", out)
    # Again: the file is not overwritten.
    assert main(["calibrate", REAL, "--runs", "3", "--quiet"]) == 2
    assert "not there yet" in capsys.readouterr().err


@pytest.mark.long
def test_a_pilot_run_that_fails_by_more_than_a_radius_ends_it_with_a_line(
        monkeypatch, tmp_path, capsys):
    Drawn(monkeypatch, {}, off_line=1.29)
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", REAL, "--runs", "3", "--quiet"]) == 1
    first, *_ = capsys.readouterr().err.splitlines()
    assert first.startswith("run 2 pressed off the desired force") and "(1.29 of it)" in first
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_deviations_that_leave_no_tube_are_named_with_their_limit(monkeypatch, tmp_path, capsys):
    Drawn(monkeypatch, {"qdot": 0.7})
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", REAL, "--runs", "3", "--quiet"]) == 1
    assert "qdot takes 105% of its limit" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
