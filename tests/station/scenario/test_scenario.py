"""Tests of `uvms_drake.station.scenario.scenario`."""

import re
import shlex

import numpy as np
import pytest
from pydrake.common.yaml import yaml_dump_typed, yaml_load_data
from support.scenarios import error_of, load_text

import uvms_drake as uv
from uvms_drake.campaign.campaign import make_campaign
from uvms_drake.common.errors import ScenarioError
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.problem import true_surface
from uvms_drake.station.scenario.scenario import dump_scenario, remarks
from uvms_drake.station.scenario.scenario_file import shipped_scenarios
from uvms_drake.station.true_wall import surface_depth


@pytest.mark.parametrize("name", shipped_scenarios())
def test_loading_the_dump_gives_the_same_scenario(name, tmp_path):
    dump = dump_scenario(uv.load_scenario(name))
    assert dump_scenario(load_text(tmp_path, dump)) == dump


def test_a_supervisor_that_is_left_out_is_left_out_of_the_dump_as_well(tmp_path):
    """Or a campaign, whose scenario is a dump, would have one again."""
    without = uv.load_scenario("girona500_contact", ["supervisor=null"])
    assert load_text(tmp_path, dump_scenario(without)).supervisor is None
    assert make_campaign(without, 1, None).base.supervisor is None
    assert load_text(tmp_path, dump_scenario(uv.load_scenario("girona500_contact"))).supervisor


@pytest.mark.parametrize("description", [
    "publish_every_time_step: is mentioned first",
    "One line.\npublish_every_time_step: false\n",
    "One line.\n  publish_every_time_step: true\nAnother line.",
    yaml_dump_typed(uv.Scenario().simulator, child_name="simulator"),
])
def test_no_text_is_lost_in_the_dump(description, tmp_path):
    """Whatever it says about a setting that is left out for the sake of other versions of Drake."""
    dump = dump_scenario(uv.Scenario(name="mine", description=description))
    assert "publish_every_time_step" not in yaml_load_data(dump)["simulator"]
    loaded = load_text(tmp_path, dump)
    assert loaded.description == description
    assert dump_scenario(loaded) == dump


@pytest.mark.parametrize("text", ["", "null", "{}", "# Nothing."])
def test_an_empty_file_is_no_scenario(text, tmp_path):
    with pytest.raises(ScenarioError, match=r"^the file = (None|\{\}): must be a mapping of keys"):
        load_text(tmp_path, text)


def test_what_a_file_does_not_say_is_the_default_and_its_name_the_files(tmp_path):
    scenario = load_text(tmp_path, "seed: 0")
    assert dump_scenario(scenario) == dump_scenario(uv.Scenario(name="mine"))


def test_a_mistake_in_the_file_is_reported_without_mention_of_overrides(tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_text("mpc: {horizn: 5}", encoding="utf-8")
    error = error_of(str(path), ["seed=1"])
    assert error.startswith("mpc.horizn = 5: must be under")
    assert error.endswith(" (bad.yaml)")


def test_a_file_that_is_no_text_is_refused(tmp_path):
    path = tmp_path / "bad.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    assert error_of(str(path)) == "cannot be read: it is not UTF-8 text (bad.yaml)"


# Tests of `uvms_drake.station.scenario.scenario_file`: bases and overrides.


def test_a_file_takes_over_what_it_does_not_say_from_its_base(tmp_path):
    scenario = load_text(
        tmp_path, "base: girona500_ideal\nduration: 10\ntask: {force: [15, 0, 0, 0, 0, 0]}\n"
        "surface: {stiffness: 800}\ndisturbance: !RandomDisturbance {bound: 0.05}\n")
    assert dump_scenario(scenario) == dump_scenario(uv.load_scenario("girona500_ideal", [
        "name=mine", "description=''", "duration=10", "task.force=[15, 0, 0, 0, 0, 0]",
        "surface.stiffness=800", "disturbance=!RandomDisturbance {bound: 0.05}"]))


def test_a_base_is_a_file_beside_and_may_have_one_itself(tmp_path):
    folder = tmp_path / "inside"
    folder.mkdir()
    (folder / "first.yaml").write_text("base: girona500_bilateral\nseed: 3\nduration: 7\n")
    (tmp_path / "second.yaml").write_text("base: inside/first.yaml\nseed: 4\n")
    scenario = uv.load_scenario(str(tmp_path / "second.yaml"), ["log_period=0.1"])
    assert (scenario.name, scenario.seed, scenario.duration) == ("second", 4, 7.0)
    assert scenario.law == uv.load_scenario("girona500_bilateral").law


@pytest.mark.parametrize(("text", "expected"), [
    ("base: girona500_contcat", "must be one of bluerov2_ceiling, bluerov2_contact"),
    ("base: mine.yaml", "base = 'mine.yaml': must be another file: this one has itself as its"),
    ("base: ''", "must be a file: this is a folder"),
    ("base: girona500_ideal\nsurface: {stifness: 1}", "surface.stifness = 1: must be under one"),
    ("base: girona500_ideal\nsurface: !BilateralSpring {}", "must be left out: K⁻¹𝔉_des"),
    ("seed: 010", "line 1: 010 is not decimal in YAML"),
    ("base: girona500_ideal\nstart: {eta: [0, 0, 0, 0, 0, 100]}",
     "must be with angles within ±2π")])
def test_what_a_file_cannot_mean_is_one_line(text, expected, tmp_path):
    (tmp_path / "mine.yaml").write_text(text)
    try:
        line = ""
        uv.make_ocp(uv.load_scenario(str(tmp_path / "mine.yaml")))
    except (ScenarioError, uv.InvalidParameter) as error:
        line = str(error)
    assert expected in line
    assert "\n" not in line


def test_overrides_change_values_at_any_depth():
    scenario = uv.load_scenario("girona500_ideal", [
        "seed=7", "surface.stiffness=2e3", "limits.u.0=0.125", "current=[0, 0.1, 0]",
        "simulator.max_step_size=1e-3"])
    assert scenario.seed == 7
    assert scenario.surface.stiffness == 2000.0
    assert scenario.limits.u[0] == 0.125
    assert scenario.simulator.max_step_size == 1e-3
    np.testing.assert_array_equal(scenario.current, [0.0, 0.1, 0.0])


def test_an_override_below_a_tag_keeps_the_tag():
    spring = uv.load_scenario("girona500_bilateral", ["surface.equilibrium.0=0.5"]).surface
    assert isinstance(spring, uv.BilateralSpring)
    assert spring.equilibrium[0] == 0.5


def test_an_override_reaches_into_what_the_file_leaves_at_its_default(tmp_path):
    scenario = load_text(tmp_path, "seed: 1", ["disturbance.bound=0.2", "surface.stiffness=50"])
    assert isinstance(scenario.disturbance, uv.SinusoidalDisturbance)
    assert scenario.disturbance.bound == 0.2
    assert isinstance(scenario.surface, uv.UnilateralPlane)
    assert scenario.surface.stiffness == 50.0


def test_private_top_level_keys_are_room_for_anchors(tmp_path):
    assert load_text(tmp_path, "_value: &value 3\nseed: *value").seed == 3


@pytest.mark.parametrize(("override", "expected"), [
    ("surface.stifness=3", "surface.stifness = 3: must be under one of the keys point, normal, "
                           "stiffness, dissipation, transition (did you mean 'stiffness'?)"),
    ("duration=long", "duration = 'long': must be a finite number"),
    ("limits.u.99=1", "limits.u.99 = 1: must be given with an index below 10"),
    ("seed", "--set = 'seed': must be key.path=value"),
    ("seed=1\nduration: 2", "seed = '1\\nduration: 2': must be a YAML value"),
])
def test_a_bad_override_is_one_line_with_the_file_the_option_and_what_is_allowed(
        override, expected):
    text = error_of("girona500_ideal", ["log_period=0.05", override])
    option = shlex.quote(" ".join(override.split()))
    source = f" (girona500_ideal.yaml with --set log_period=0.05 --set {option})"
    assert text.endswith(source)
    assert expected in text.removesuffix(source)


def test_a_bad_override_is_named_where_it_makes_another_value_bad():
    assert error_of("girona500_ideal", ["duration=0.001"]) == (
        "log_period = 0.02: must be at most the duration, 0.001 s "
        "(girona500_ideal.yaml with --set duration=0.001)")


def test_an_unknown_scenario_names_the_shipped_ones_and_the_closest():
    assert error_of("girona500_contcat") == (
        f"scenario = 'girona500_contcat': must be one of {', '.join(shipped_scenarios())}, "
        "or a YAML file that exists (did you mean 'girona500_contact'?)")


def test_a_robot_stands_beside_the_file_that_names_it_or_where_the_program_runs(
        tmp_path, monkeypatch):
    (tmp_path / "lab" / "otter").mkdir(parents=True)
    (tmp_path / "lab" / "girona500_arm5e").mkdir()  # A shipped name goes first.
    for file, text in (("lab/mine.yaml", "base: girona500_ideal\nmodel: otter\n"),
                       ("lab/shipped.yaml", "model: girona500_arm5e\n"),
                       ("other.yaml", "base: lab/mine.yaml\n")):
        (tmp_path / file).write_text(text)
    for folder, file, expected in (
            ("", "lab/mine.yaml", "lab/otter"), ("", "other.yaml", "lab/otter"),
            ("lab", "mine.yaml", "otter"), ("", "lab/shipped.yaml", "girona500_arm5e")):
        monkeypatch.chdir(tmp_path / folder)
        assert uv.load_scenario(file).model == expected
    monkeypatch.chdir(tmp_path / "lab")
    assert uv.load_scenario("girona500_ideal", ["model=otter"]).model == "otter"


# Tests of `uvms_drake.station.scenario.remarks`.


@pytest.mark.parametrize("name", list(shipped_scenarios()))
def test_nothing_is_in_vain_in_a_shipped_scenario(name):
    assert remarks(uv.load_scenario(name)) == []


@pytest.mark.parametrize(("override", "expected"), [
    ("faults=[{start: 3}, !LostState {start: 20}]",
     "faults[1].start = 20 s is after the end of the run: it never happens"),
    ("task.pose.0=7", "task.pose is 6.98 m off the surface: along its normal, the desired force "
     "determines the position"),
    ("mpc.hover=30", "mpc.hover = 30 s is not before the end of the run: the robot only hovers, "
     "and no tube is monitored without a certificate"),
    ("simulator.max_step_size=1",
     "simulator.max_step_size = 1 s is cut to 0.02 s by the log or the MPC"),
    ("sensing=[!ForceSensor {}, !Navigation {}]", "sensing[0] measures the force in the true "
     "attitude: parts that change the measured one come after it")])
def test_what_has_no_effect_is_said(override, expected):
    assert remarks(uv.load_scenario("girona500_ideal", [override])) == [expected]


# D24: a distance in the text of a scenario is that of its start, not one of three numbers.


SAID = re.compile(r"(\d\.\d+) m (?:off|to a)\b")
FILES = {name: path.read_text(encoding="utf-8") for name, path in shipped_scenarios().items()}


@pytest.mark.parametrize("name", [name for name, text in FILES.items() if SAID.search(text)])
def test_the_distance_that_a_scenario_names_is_that_of_its_start(name):
    scenario = uv.load_scenario(name)
    model, surface = uv.load_model(scenario), true_surface(scenario)
    chi = model.task_pose(scenario.start.config)[None, :6]
    desired = np.asarray(scenario.task.force, dtype=float)[:3]
    n = (sensed_contact(scenario).direction if isinstance(scenario.contact, uv.SensedContact)
         else desired / np.linalg.norm(desired))
    away = float((surface_depth(surface, chi, n) - chi[:, :3] @ n)[0])
    said = {float(number) for number in SAID.findall(FILES[name])}
    assert len(said) == 1, "one number in one file"
    assert away == pytest.approx(said.pop(), abs=0.05)
