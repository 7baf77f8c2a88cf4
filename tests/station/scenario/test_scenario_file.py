"""Tests of `uvms_drake.station.scenario.scenario_file`: bases and overrides."""

import shlex

import numpy as np
import pytest
from support.scenarios import error_of, load_text

from uvms_drake.common.errors import InvalidParameter, ScenarioError
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.surface.spring import BilateralSpring
from uvms_drake.plant.disturbance import RandomDisturbance, SinusoidalDisturbance
from uvms_drake.station.problem import make_ocp
from uvms_drake.station.scenario.scenario import dump_scenario, load_scenario
from uvms_drake.station.scenario.scenario_file import scenario_path, shipped_scenarios

SHIPPED = ("bluerov2_ceiling", "bluerov2_contact", "bluerov2_cp_probe", "bluerov2_ideal",
           "bluerov2_real_loop", "girona500_bilateral", "girona500_contact",
           "girona500_contact_uncertain", "girona500_floor",
           "girona500_ideal", "girona500_inspection", "girona500_real_loop",
           "girona500_slope", "girona500_stiff", "girona500_tip_first",
           "girona500_unknown_floor", "jacket_inspection", "jacket_inspection_real",
           "paper_dynamic", "paper_dynamic_resolved", "paper_kinematic",
           "paper_kinematic_certified")


def test_the_scenarios_are_shipped():
    assert tuple(shipped_scenarios()) == SHIPPED


def test_a_file_takes_over_what_it_does_not_say_from_its_base(tmp_path):
    scenario = load_text(
        tmp_path, "base: girona500_ideal\nduration: 10\ntask: {force: [15, 0, 0, 0, 0, 0]}\n"
        "surface: {stiffness: 800}\ndisturbance: !RandomDisturbance {bound: 0.05}\n")
    assert dump_scenario(scenario) == dump_scenario(load_scenario("girona500_ideal", [
        "name=mine", "description=''", "duration=10", "task.force=[15, 0, 0, 0, 0, 0]",
        "surface.stiffness=800", "disturbance=!RandomDisturbance {bound: 0.05}"]))


def test_a_base_is_a_file_beside_and_may_have_one_itself(tmp_path):
    folder = tmp_path / "inside"
    folder.mkdir()
    (folder / "first.yaml").write_text("base: girona500_bilateral\nseed: 3\nduration: 7\n")
    (tmp_path / "second.yaml").write_text("base: inside/first.yaml\nseed: 4\n")
    scenario = load_scenario(str(tmp_path / "second.yaml"), ["log_period=0.1"])
    assert (scenario.name, scenario.seed, scenario.duration) == ("second", 4, 7.0)
    assert scenario.law == load_scenario("girona500_bilateral").law


@pytest.mark.parametrize(("text", "expected"), [
    ("base: girona500_contcat", "must be one of bluerov2_ceiling, bluerov2_contact"),
    ("base: nothing.yaml", "must be a file that exists, or one of"),
    ("base: mine.yaml", "base = 'mine.yaml': must be another file: this one has itself as its"),
    ("base: [girona500_ideal]", "base = ['girona500_ideal']: must be a shipped scenario's"),
    ("base: ''", "must be a file: this is a folder"),
    ("base: girona500_ideal\nsurface: {stifness: 1}", "surface.stifness = 1: must be under one"),
    ("base: girona500_ideal\nsurface: !BilateralSpring {}", "must be left out: K⁻¹𝔉_des"),
    ("seed: 010", "line 1: 010 is not decimal in YAML"),
    ("base: girona500_ideal\nduration: 1:30", "line 2: 1:30 is not decimal in YAML"),
    ("seed: 1e30", "seed = 1000000000000000019884624838656: must be at most 9223372036854775807"),
    ("base: girona500_ideal\nstart: {eta: [0, 0, 0, 0, 0, 100]}",
     "must be with angles within ±2π")])
def test_what_a_file_cannot_mean_is_one_line(text, expected, tmp_path):
    (tmp_path / "mine.yaml").write_text(text)
    try:
        line = ""
        make_ocp(load_scenario(str(tmp_path / "mine.yaml")))
    except (ScenarioError, InvalidParameter) as error:
        line = str(error)
    assert expected in line
    assert "\n" not in line


def test_a_file_of_the_same_content_loads_by_path():
    path = str(scenario_path("girona500_ideal"))
    assert dump_scenario(load_scenario(path)) == dump_scenario(load_scenario("girona500_ideal"))


def test_overrides_change_values_at_any_depth():
    scenario = load_scenario("girona500_ideal", [
        "seed=7", "surface.stiffness=2e3", "limits.u.0=0.125", "current=[0, 0.1, 0]",
        "simulator.max_step_size=1e-3"])
    assert scenario.seed == 7
    assert scenario.surface.stiffness == 2000.0
    assert scenario.limits.u[0] == 0.125
    assert scenario.simulator.max_step_size == 1e-3
    np.testing.assert_array_equal(scenario.current, [0.0, 0.1, 0.0])


def test_an_override_below_a_tag_keeps_the_tag():
    spring = load_scenario("girona500_bilateral", ["surface.equilibrium.0=0.5"]).surface
    assert isinstance(spring, BilateralSpring)
    assert spring.equilibrium[0] == 0.5


def test_an_override_reaches_into_what_the_file_leaves_at_its_default(tmp_path):
    scenario = load_text(tmp_path, "seed: 1", ["disturbance.bound=0.2", "surface.stiffness=50"])
    assert isinstance(scenario.disturbance, SinusoidalDisturbance)
    assert scenario.disturbance.bound == 0.2
    assert isinstance(scenario.surface, UnilateralPlane)
    assert scenario.surface.stiffness == 50.0


def test_an_override_with_a_tag_changes_the_type():
    scenario = load_scenario("girona500_ideal", [
        "disturbance=!RandomDisturbance {bound: 0.05, bandwidth: 2}"])
    assert type(scenario.disturbance) is RandomDisturbance
    assert (scenario.disturbance.bound, scenario.disturbance.bandwidth) == (0.05, 2.0)


def test_an_optional_value_can_be_taken_away():
    assert load_scenario("girona500_ideal", ["task.pose=null"]).task.pose is None


def test_the_last_override_of_a_key_wins():
    assert load_scenario("girona500_ideal", ["seed=1", "seed=2"]).seed == 2


def test_private_top_level_keys_are_room_for_anchors(tmp_path):
    assert load_text(tmp_path, "_value: &value 3\nseed: *value").seed == 3


@pytest.mark.parametrize(("override", "expected"), [
    ("surface.stifness=3", "surface.stifness = 3: must be under one of the keys point, normal, "
                           "stiffness, dissipation, transition (did you mean 'stiffness'?)"),
    ("simulator.accurcy=3", "(did you mean 'accuracy'?)"),
    ("duration=long", "duration = 'long': must be a finite number"),
    ("duration.x=1", "duration = {'x': 1}: must be a finite number"),
    ("seed=0.5", "seed = 0.5: must be a whole number"),
    ("current=[0, 0, .inf]", "current[2] = inf: must be a finite number"),
    ("limits.u.99=1", "limits.u.99 = 1: must be given with an index below 10"),
    ("surface=!Wall {}", "surface = '!Wall': must be a mapping tagged !UnilateralPlane or "
                         "!BilateralSpring"),
    ("seed", "--set = 'seed': must be key.path=value"),
    ("a..b=1", "--set = 'a..b=1': must be key.path=value"),
    ("seed=[1", "seed = '[1': must be a YAML value"),
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
        f"scenario = 'girona500_contcat': must be one of {', '.join(SHIPPED)}, "
        "or a YAML file that exists (did you mean 'girona500_contact'?)")


def test_a_robot_that_is_not_as_it_is_known_comes_from_a_file_and_goes_back_into_one(tmp_path):
    scenario = load_scenario("girona500_ideal", [
        "model_error={buoyancy: 0.98, payload: {mass: 0.5}, joint_friction: {coulomb: [0.5]}}"])
    error = scenario.model_error
    assert (error.buoyancy, error.payload.mass, error.joint_friction.largest) == (0.98, 0.5, 0.5)
    assert error.joint_friction.creep == 0.005
    path = tmp_path / "mine.yaml"
    path.write_text(dump_scenario(scenario))
    assert dump_scenario(load_scenario(str(path))) == dump_scenario(scenario)
    with pytest.raises(ScenarioError, match=r"model_error\.payload\.mass = -1\.0: must be from 0"):
        load_scenario("girona500_ideal", ["model_error.payload.mass=-1"])


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
        assert load_scenario(file).model == expected
    monkeypatch.chdir(tmp_path / "lab")
    assert load_scenario("girona500_ideal", ["model=otter"]).model == "otter"
