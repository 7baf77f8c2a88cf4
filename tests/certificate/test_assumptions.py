"""What a certificate assumes, and declared unknowns against Drake's plant."""

import re
from dataclasses import replace

import numpy as np
import pytest
from support.quick import FEW, search_less
from support.scenarios import OF_A_STATION

import uvms_drake as uv
from uvms_drake.campaign.draws import declared_distribution
from uvms_drake.certificate import assumptions as assumed
from uvms_drake.certificate import declared_unknowns as declared
from uvms_drake.certificate.certificate import fingerprint
from uvms_drake.certificate.certify import basis_of
from uvms_drake.certificate.text import help_for
from uvms_drake.common.errors import InvalidParameter, ScenarioError
from uvms_drake.control.limits import TubeRadii
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.plant.waves import water_motion
from uvms_drake.station.contact.tube_in_contact import force_bounds
from uvms_drake.station.plant import make_simulated_uvms
from uvms_drake.station.problem import check_inputs, load_model
from uvms_drake.station.supervision import silent_conditions
from uvms_drake.tube.estimates import LEAST_SHARE
from uvms_drake.tube.unmodelled_dynamics import MotionSet

REAL = ("bluerov2_real_loop", "girona500_real_loop", "jacket_inspection_real")
"""Scenarios with thrusters, which are not certified."""


def unmet(scenario):
    return [item.name for item in assumed.assumed_conditions(scenario)
            if not item.holds]


@pytest.mark.parametrize("name", OF_A_STATION)
def test_every_assumption_is_a_statement_with_a_guarantor_and_names_undriven_axes(name):
    scenario = uv.load_scenario(name)
    model = uv.load_model(scenario)
    found = assumed.assumptions_of(scenario, model)
    scope = assumed.scope_of(found)
    unknown = np.any(scenario.current) or scenario.model_error.size > 0.0
    M = model.mass_matrix(model.kinematics(scenario.start.config))
    asked = (np.abs(M) @ scenario.limits.u)[6:]
    if scenario.limits.tau is not None:
        asked = np.minimum(asked, scenario.limits.tau[6:])
    beyond = np.any(asked > model.joint_effort)
    assert list(scope) == [about for about in assumed.SCOPE if {
        "unknowns": unknown, assumed.MOTORS: beyond, "logs": False, "excitation": False}.get(
            about, True)]
    assert scope["sensing"].startswith(
        "pose, velocity and joint angles of !Navigation, which no proof" if name in REAL else
        "exact pose, velocity and joint angles, in continuous time")
    if scenario.contact.declared_wall() is not None:
        assert "stands still and is elastic" in scope["surface"]
        assert "exactly first order" in scope["sensing"]
    assert all(item.statement and item.guaranteed_by for item in found)
    assert len({item.statement for item in found}) == len(found)
    if name not in REAL:
        assert assumed.unnamed_axes(scenario.actuation, model) == ()
        assert ("NOT girona500_arm5e as it is, whose thrusters drive no roll" in scope["actuation"]
                ) == (scenario.model == "girona500_arm5e")


def test_a_robot_with_undriven_axes_is_not_certified_unless_the_scenario_names_them():
    for override in ("actuation=[]", "actuation=[!IdealWrench {}]",
                     "actuation=[!IdealWrench {undriven: [sway]}]"):
        scenario = uv.load_scenario("girona500_ideal", [override])
        (name,) = unmet(scenario)
        assert name.endswith("unnamed by an !IdealWrench: roll")
    (advice,) = [item.advice for item in assumed.assumed_conditions(scenario)
                 if not item.holds]
    assert advice.startswith("--set 'actuation=[!IdealWrench {undriven: [roll]}]'")
    assert unmet(uv.load_scenario("girona500_ideal")) == []
    assert unmet(uv.load_scenario("bluerov2_ideal", ["actuation=[]"])) == []


IDENTIFIED = """
identified:
  logs: [a (SHA-256 01), b (SHA-256 02), c (SHA-256 03), d (SHA-256 04)]
  hydrodynamics: '%s'
  nu1: 0.1
  nu2: 0.3
  nu2_dot: 9
  qdot: 0.15
"""


def identified(folder, text=IDENTIFIED, **changes):
    """Returns a scenario with the logs of an identification of its own robot."""
    digest = fingerprint(uv.load_scenario("bluerov2_contact"))["files"]["hydrodynamics.yaml"]
    limits = "limits: {nu1: 0.2, nu2: 0.3, qdot: 0.2, u: [3, 4, 0, 1, 0, 0, 1, 1, 1, 1]}\n"
    path = folder / "scenario.yaml"
    path.write_text(f"base: bluerov2_contact\n{limits}{text % changes.get('of', digest)}",
                    encoding="utf-8")
    return uv.load_scenario(str(path))


def test_a_verdict_names_the_logs_their_excitation_beside_limits_and_where_these_go_beyond(
        tmp_path):
    scenario = identified(tmp_path)
    found = assumed.assumptions_of(scenario, uv.load_model(scenario))
    scope = assumed.scope_of(found)
    assert scope["logs"] == ("numbers of the water are from 4 logs: a (SHA-256 01), "
                             "b (SHA-256 02), c (SHA-256 03) and 1 more")
    assert "d (SHA-256 04)" in [each.statement for each in found]
    assert scope["excitation"] == (
        "largest of the logs (of the limits): ‖ν₁‖ 0.1 (0.2 m/s), ‖ν₂‖ 0.3 (0.3 rad/s), "
        "‖ν̇₁‖ not measured (5 m/s²), ‖ν̇₂‖ 9 (1 rad/s²), ‖q̇‖ 0.15 (0.2 rad/s); "
        "extrapolates in ‖ν₁‖ by 0.1 m/s, ‖ν̇₁‖, ‖q̇‖ by 0.05 rad/s")
    assert unmet(scenario) == []
    # A certificate depends on them, one in probability says it, and another robot is refused.
    other = identified(tmp_path, IDENTIFIED.replace("0.15", "0.16"))
    assert fingerprint(other)["inputs"] != fingerprint(scenario)["inputs"]
    assert list(scope.values())[-2:] == [
        each for each in declared_distribution(scenario) if each in scope.values()]
    with pytest.raises(InvalidParameter, match=r"= .00.: must be that of .* of bluer"):
        check_inputs(identified(tmp_path, of="00"))


@pytest.mark.parametrize(("old", "new", "line"), [
    ("nu1: 0.1", "nu1: -0.1", "identified.nu1 = -0.1: must be zero or positive"),
    ("[a (SHA-256 01), b (SHA-256 02), c (SHA-256 03), d (SHA-256 04)]", "[]",
     r"identified.logs = \[\]: must be the logs, at least one"),
    ("qdot: 0.15", "qdots: 0.15", "identified.qdots = 0.15: must be under one of the keys logs")])
def test_a_bad_value_of_an_identification_is_one_line(old, new, line, tmp_path):
    with pytest.raises(ScenarioError, match=line):
        identified(tmp_path, IDENTIFIED.replace(old, new))


def test_limits_of_thrusters_are_no_wrench_on_an_undriven_axis():
    scenario = uv.load_scenario("girona500_ideal", ["limits.thrusters=[1]", "actuation=[]"])
    assert assumed.undriven_axes(uv.load_model(scenario)) == ("roll",)
    assert unmet(scenario)


def test_torques_beyond_the_motors_are_said_with_their_numbers_unless_limits_tau_keeps_to_them():
    def said(*overrides):
        scenario = uv.load_scenario(NAME, list(overrides))
        return assumed.scope_of(assumed.assumptions_of(
            scenario, uv.load_model(scenario))).get(assumed.MOTORS, "")

    assert "102 N m of joint 2, whose motor gives 70; 49.1 N m of joint 3" in said()
    assert "joint 4" not in said()
    assert said("limits.tau=[500, 500, 500, 500, 500, 500, 50, 70, 35, 14]") == ""
    assert said("limits.tau=[500, 500, 500, 500, 500, 500, 50, 80, 35, 14]").endswith(
        "limits.u and limits.tau may ask for up to 80 N m of joint 2, whose motor gives 70: "
        "assumed not to be asked for; a run in which a motor cuts one has no guarantee")


NAME = "girona500_contact"
RUNS = 40
"""Number of random motions."""
FAR = "surface.geometry.point=[100, 0, 0]"
WEIGHTS = np.repeat([0.1, 0.2, 1.0], [3, 3, 4])
RADII = TubeRadii(
    e=0.01, position=0.002, orientation=0.007, joints=0.004, z=0.17, nu1=0.008, nu2=0.01,
    qdot=0.169, tip_speed=0.095, roll=0.001, pitch=0.001,
    u=np.array([0.66, 0.64, 0.57, 0.56, 0.62, 0.58, 12.1, 13.5, 18.7, 10.7]))
TOGETHER = ["model_error.mass=1.05", "model_error.drag=0.8", "current=[0.05, -0.06, 0.03]",
            "model_error.joint_friction.coulomb=[0.05]",
            "waves=[{amplitude: 0.05, period: 5.0, depth: 3.0, direction: 1.0}]"]
CASES = {name: [override] for name, override in (
    ("mass", TOGETHER[0]), ("drag", TOGETHER[1]), ("current", TOGETHER[2]),
    ("friction", TOGETHER[3]), ("waves", TOGETHER[4]),
    ("buoyancy", "model_error.buoyancy_shift=[0.01, 0, 0.005]"))} | {
    "by axis": ["model_error.vehicle.added_mass=[1.1, 1, 1, 1.2, 1, 1]",
                "model_error.arm.quadratic_drag=[1.5]"], "all": TOGETHER}


@pytest.fixture(scope="module")
def basis():
    with pytest.MonkeyPatch.context() as patch:
        search_less(patch)
        scenario = uv.load_scenario(NAME, FEW)
        return replace(basis_of(scenario, uv.load_model(scenario)), weights=WEIGHTS)


def bounds_in(scenario, basis):
    return declared.UnmodelledBounds(scenario.model, basis, RADII)


def effects_of(scenario, basis):
    return declared.unknown_effects(scenario.unknowns, bounds_in(scenario, basis),
                           declared.weights_of(scenario.disturbance, basis))


def condition_of(scenario, basis, effects):
    return declared.unknowns_condition(
        scenario.disturbance, scenario.unknowns, bounds_in(scenario, basis), effects)


@pytest.mark.parametrize("name", ["mass", *(
    pytest.param(name, marks=pytest.mark.long) for name in CASES if name != "mass")])
def test_no_motion_of_the_plant_is_off_by_more_than_the_sum(name, basis):
    """ζ̇ of the simulated robot in its water, less ζ̇_c, at random motions and rates."""
    scenario = uv.load_scenario(NAME, [*FEW, FAR, *CASES[name]])
    effects = effects_of(scenario, basis)
    total = sum(each.takes for each in effects)
    each = sum(np.array(effect.each) for effect in effects)
    rate = bounds_in(scenario, basis).rate
    # Random motions of the set, many on its faces.
    motions = MotionSet(basis.model, basis.declared)
    rng, (lower, upper) = np.random.default_rng(5), motions.box
    unit = np.clip(rng.uniform(-0.3, 1.3, (RUNS, len(lower))), 0.0, 1.0)
    at = motions.at(lower + unit * (upper - lower))
    asked = rate(at) * rng.choice([-1.0, 1.0], (RUNS, 10))
    plant = make_simulated_uvms(scenario, ConstantDisturbance())
    context, off = plant.CreateDefaultContext(), np.empty((RUNS, 10))
    for i, time in enumerate(rng.uniform(0.0, 5.0, RUNS)):
        uv.set_state(plant, context, np.concatenate([at.config[i], at.zeta[i]]))
        tau = basis.model.inverse_dynamics(
            at.kinematics.at(i), at.zeta[i], asked[i], np.zeros(6))
        for port, value in zip(("tau", "current", "current_acceleration"),
                               (tau, *water_motion(scenario.current, scenario.waves, time)),
                               strict=True):
            plant.GetInputPort(port).FixValue(context, value)
        off[i] = plant.GetOutputPort("acceleration").Eval(context) - asked[i]
    norm = np.linalg.norm(off / WEIGHTS, axis=1)
    assert np.max(norm) <= total
    assert np.all(np.max(np.abs(off), axis=0) <= each + 1e-9)
    assert np.max(norm) > 0.2 * total


def test_the_terms_of_a_source_do_not_change_by_those_after_it(basis):
    """Or a second search would be of another function than the first."""
    scenario, effects = uv.load_scenario(NAME, [*FEW, *TOGETHER]), list[declared.UnknownEffect]()
    bounds, kept = bounds_in(scenario, basis), []
    motions = MotionSet(basis.model, basis.declared)
    at = motions.at(np.mean(motions.box, axis=0, keepdims=True))

    def sizes(term):
        return [float(np.sum(np.abs(part))) for part in term(at)]

    for source in declared.declared_sources(scenario.unknowns, bounds, effects):
        kept.append((source, [sizes(term) for term in source.terms]))
        effects.append(declared.UnknownEffect(source.name, 1.0, (0.5,) * 10))
    assert len(kept) == 4
    for source, first in kept:
        assert [sizes(term) for term in source.terms] == first


@pytest.mark.long
def test_the_sum_has_to_fit_into_the_share_and_the_verdict_says_by_how_much(basis):
    scenario = uv.load_scenario(NAME, [*FEW, "model_error.drag=1.02", "current=[0.005, 0, 0]"])
    effects = effects_of(scenario, basis)
    assert [each.name for each in effects] == ["drag off by 0.02", "a current of 0.005 m/s"]
    failed = condition_of(scenario, basis, effects)
    total = sum(each.takes for each in effects)
    assert (failed.left, failed.right, failed.holds) == (total, 0.0, False)
    assert f"a current of 0.005 m/s: {effects[1].takes:.3g}" in failed.name
    bound = float(2.0 * total)
    wide = replace(scenario, disturbance=replace(scenario.disturbance, bound=bound))
    failed = condition_of(wide, basis, effects)
    assert failed.advice.startswith("--set model_error.share=0.5")
    shared = replace(wide, model_error=replace(wide.model_error, share=0.51))
    assert condition_of(shared, basis, effects).holds
    narrow = replace(wide, disturbance=replace(wide.disturbance, bound=0.5 * total))
    fitted = declared.fitting_disturbance(
        narrow.disturbance, narrow.unknowns, bounds_in(narrow, basis))
    advice = condition_of(narrow, basis, effects).advice
    assert advice.startswith(f"--set disturbance.bound={fitted.bound:g} --set disturbance.weights=")
    assert advice.endswith("--set model_error.share=0.95")


@pytest.mark.long
@pytest.mark.parametrize("name", ["current", "friction"])
def test_the_disturbance_that_is_advised_takes_the_unknowns_and_little_more(name, basis):
    scenario = uv.load_scenario(NAME, [*FEW, *CASES[name]])
    given = declared.fitting_disturbance(
        scenario.disturbance, scenario.unknowns, bounds_in(scenario, basis))
    fitted = replace(scenario, disturbance=given, model_error=replace(
        scenario.model_error, share=declared.RESERVED))
    (effect,) = effects_of(fitted, replace(basis, weights=given.weights))
    assert condition_of(fitted, basis, [effect]).holds
    assert declared.RESERVED * given.bound < 1.01 * effect.takes
    assert np.max(given.weights) == 1.0
    # No component of the ellipsoid is much larger than it has to be.
    proportion = np.array(effect.each) / (given.weights * given.bound)
    assert np.all(proportion[given.weights > declared.LEAST_WEIGHT] > 0.2)
    assert np.all(proportion <= 1.0)
    assert type(given) is type(scenario.disturbance)


@pytest.mark.parametrize("name", [
    "mass", pytest.param("current", marks=pytest.mark.long)])
def test_a_second_search_does_not_refute_the_first(name, basis):
    scenario = uv.load_scenario(NAME, [*FEW, *CASES[name]])
    (effect,), check, _ = declared.declared_effects(scenario, basis, RADII)
    estimates = check()
    assert {each.name.partition(" [")[0] for each in estimates} == {
        declared.DRIFT, f"d by {effect.name}"}
    assert all(LEAST_SHARE <= each.ratio <= 1.0 for each in estimates)


@pytest.mark.long
def test_a_payload_is_read_twice_over_and_accelerates_no_more_than_it_says(basis):
    scenario = uv.load_scenario(NAME, [*FEW, "model_error.payload.mass=0.1"])
    effects = effects_of(scenario, basis)
    bounds = bounds_in(scenario, basis)
    found = declared.payload_acceleration(scenario, bounds, effects)
    failed = declared.payload_condition(scenario.model_error.payload.acceleration, found)
    assert failed.advice.startswith("--set model_error.payload.acceleration=")
    allowed = uv.load_scenario(NAME, [*FEW, "model_error.payload.mass=0.1",
                                   failed.advice.removeprefix("--set ")])
    assert declared.payload_condition(allowed.model_error.payload.acceleration, found).holds
    # The change of its weight and inertia since the tare.
    plain, heavy = (force_bounds(each) for each in (
        uv.load_scenario(NAME, FEW), allowed))
    most = 9.81 + allowed.model_error.payload.acceleration
    assert heavy.error - plain.error == pytest.approx(2.0 * 0.1 * most)
    nothing = uv.load_scenario(NAME, FEW)
    assert declared.payload_acceleration(nothing, bounds, ()) is None
    _, check, conditions = declared.declared_effects(allowed, basis, RADII)
    hand = check()[-1]
    assert hand.name == declared.HAND
    assert LEAST_SHARE <= hand.ratio <= 1.0
    assert [each.topic for each in conditions] == ["declared unknowns", "model_error"]


@pytest.mark.parametrize(("overrides", "names"), [
    (["current=[0.1, 0, 0]", "model_error.mass=1.1"], []),
    (["current=[0.1, 0, 0]", "actuation=[!SampledCommand {}, !IdealWrench {undriven: [roll]}]"],
     ["actuation[0]", "current"]),
    (["model_error.payload.mass=0.1"], [])])
def test_what_no_theorem_counts_is_named(overrides, names):
    scenario = uv.load_scenario(NAME, overrides)
    found = assumed.assumed_conditions(scenario)
    assert [item.name.partition(",")[0] for item in found if not item.holds] == names


@pytest.mark.parametrize(("change", "name"), [
    ("contact.dissipation=7.0", "damping"), ("contact.delay=0.985", "age of a reading"),
    ("log_period=0.979", "age of a reading"),
    ("faults=[!SolverFailure {probability: 0.05}]", "age of a plan")])
def test_what_the_silence_of_the_supervisor_assumes_is_a_condition(change, name):
    """With damping of a tip that is too fast, a reading bounds no force before it."""
    scenario = uv.load_scenario("girona500_stiff")
    model = load_model(scenario)
    found = silent_conditions(scenario, model)
    assert found and all(item.holds for item in found)
    assert not silent_conditions(uv.load_scenario("girona500_stiff", ["supervisor=null"]), model)
    assert not silent_conditions(uv.load_scenario("girona500_ideal"), model)
    failed = [item for item in silent_conditions(uv.load_scenario(
        "girona500_stiff", [change]), model) if not item.holds]
    assert any(name in item.name and "supervisor: null" in help_for(item) for item in failed)


def test_a_supervisor_is_an_input_of_the_certificate():
    given, none = (fingerprint(uv.load_scenario("girona500_stiff", changes))["inputs"]
                   for changes in ([], ["supervisor=null"]))
    assert given != none


def test_the_scope_has_the_least_of_the_wrench_that_thrusters_lack():
    """The sway of a Girona 500 is that of one thruster across, with what the others balance."""
    scenario = uv.load_scenario("girona500_contact")
    model = uv.load_model(scenario)
    text = assumed.scope_of(assumed.assumptions_of(scenario, model))["actuation"]
    given, asked = (float(each) for each in re.search(
        r"give (\S+) N of the (\S+) N that the limits may ask for in sway", text).groups())
    thrusters = ThrusterModel.of(model.thrusters)
    B, (y,) = thrusters.B, np.flatnonzero(np.abs(thrusters.B[1]) > 0.5)
    ways = []
    for f in (thrusters.lower[y], thrusters.upper[y]):
        # The pair in surge holds the yaw of the one across.
        surge = np.flatnonzero(np.abs(B[0]) > 0.5)
        pair = np.linalg.solve(B[np.ix_([0, 5], surge)], -B[[0, 5], y] * f)
        assert np.all((thrusters.lower[surge] <= pair) & (pair <= thrusters.upper[surge]))
        ways.append(abs(f))
    assert given == pytest.approx(min(ways), rel=1e-2)
    M = model.mass_matrix(model.kinematics(scenario.start.config))
    assert asked == pytest.approx(np.abs(M[1]) @ scenario.limits.u, rel=1e-2)


@pytest.mark.parametrize(("settings", "counted"), [
    (["waves=[{amplitude: 0.05}]"], True), (["current=[0.05, 0, 0]"], True),
    (["waves=[{amplitude: 0.05}, {amplitude: 0.02, period: 3}]"], False),
    (["waves=[{amplitude: 0.05}]", "current=[0.05, 0, 0]"], False)])
def test_waves_of_phases_and_headings_of_their_own_are_not_counted_together(settings, counted):
    conditions = assumed.assumed_conditions(uv.load_scenario("girona500_contact", settings))
    assert [each.name for each in conditions if not each.holds] == ([] if counted else [
        "waves, each wave and a current have a phase and a heading of their own"])
