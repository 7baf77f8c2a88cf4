"""The measured force in the closed loop: wiring, what it adds to d, faults, and what is refused."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from pydrake.systems.primitives import ConstantVectorSource, PassThrough
from support.unknown_wall import close_to_the_wall

import uvms_drake as uv
from uvms_drake.certificate.assumptions import assumed_conditions
from uvms_drake.control.feedback.tube_monitor import TUBE_REPORT
from uvms_drake.model.surface.law import check_surface
from uvms_drake.report.events import events
from uvms_drake.sensing.faults import FrozenForce, JumpedForce, LostForce, SaturatedForce
from uvms_drake.sensing.force_sensor import ForceSensor
from uvms_drake.station.contact.bounds import sensed_contact
from uvms_drake.station.problem import true_surface

CLOSE = "start.eta=[-1.13, -0.05, -0.05, 0.02, 0.02, 0.05]"
"""The tip starts 4 cm off the wall and touches it within a second."""
SENSOR = ForceSensor(tare=0.2)


def scenario_of(duration: float, *overrides, **changes):
    scenario = uv.load_scenario("girona500_ideal", [f"duration={duration}", CLOSE, *overrides])
    return replace(scenario, **{"sensing": [SENSOR], **changes})


def given_up(scenario) -> list[str]:
    return [condition.name for condition in assumed_conditions(scenario) if not condition.holds]


@dataclass
class TrueForce(uv.Part):
    """Measures the force as it is."""

    def add_to(self, builder, model, port, signals, seed):
        force = builder.AddNamedSystem("force", PassThrough(6))
        builder.Connect(signals["force"], force.get_input_port())
        signals["force_measured"] = force.get_output_port()
        return port


@dataclass
class NoForce(uv.Part):
    """Says that nothing is touched, or that it does not know."""

    value: float = 0.0

    def add_to(self, builder, model, port, signals, seed):
        force = builder.AddNamedSystem("force", ConstantVectorSource(np.full(6, self.value)))
        signals["force_measured"] = force.get_output_port()
        return port


def force_on_the_robot(record, force):
    """Returns M⁻¹Jᵀ𝔉 (T, 6+n)."""
    model = uv.ContactModel.load(record.scenario.model, check_surface(record.scenario.surface))
    kinematics = model.kinematics(record.config)
    torque = kinematics.J_chi.swapaxes(-1, -2) @ force[..., None]
    return np.linalg.solve(model.mass_matrix(kinematics), torque)[..., 0]


def test_a_perfect_sensor_of_a_known_wall_changes_nothing():
    """𝔉_s = 𝔉 is what the law of the surface says too, but for rounding."""
    plain, felt = (uv.simulate(scenario_of(1.5, sensing=parts)) for parts in ([], [TrueForce()]))
    assert np.max(plain.force[:, 0]) > 15.0
    np.testing.assert_allclose(felt.state, plain.state, atol=1e-6)
    np.testing.assert_array_equal(felt.signals["force_last_valid"], felt.force)


def on_another_wall(duration: float, **changes):
    """5 mm nearer, a quarter as stiff as is believed; the tube has room for a sensor."""
    return scenario_of(
        duration, "surface_error.shift=[-0.005, 0, 0]", "surface_error.stiffness=0.25",
        "log_period=0.01", "tube.e=0.012", "tube.position=0.008", "tube.orientation=0.008",
        "tube.joints=0.004", "tube.z=0.06", **changes)


@pytest.fixture(scope="module")
def run():
    return uv.simulate(on_another_wall(3.0))


def exits(record) -> float:
    return dict(zip(TUBE_REPORT, record.tube_report, strict=True))["set_exits"]


def test_a_wall_that_is_felt_keeps_the_tube_and_a_wall_that_is_believed_in_does_not(run):
    """The plan presses to the depth that it believes in: the force is as wrong as the wall."""
    known = uv.simulate(on_another_wall(2.0, sensing=[]))
    assert exits(known) > 0.0
    assert exits(run) == 0.0
    for part in ("position", "orientation", "joints"):
        radius = getattr(run.scenario.tube, part)
        assert np.max(run.deviation_of(part)) < 0.7 * radius
        assert np.max(known.deviation_of(part)) > 1.5 * radius
    assert run.force[-1, 0] < run.desired_force[-1, 0] - 5.0


def test_the_error_of_the_sensor_is_all_that_the_wall_adds_to_the_disturbance(run):
    felt = run.signals["force_last_valid"]
    np.testing.assert_array_equal(felt, run.signals["force_measured"])
    assert np.max(np.abs(felt - run.force)[:, :3]) < 3.0 < np.max(run.force[:, 0])
    np.testing.assert_allclose(
        run.effective_disturbance,
        run.disturbance + force_on_the_robot(run, felt - run.force), atol=1e-8)


def test_the_deviation_stays_within_what_that_disturbance_makes_of_the_bound_along_the_run(run):
    """The cascade is linear: D = max ‖d + M⁻¹Jᵀ(𝔉_s − 𝔉)‖ takes its bound to D/d̃ times itself."""
    largest = np.max(np.linalg.norm(run.effective_disturbance, axis=1))
    bound = largest / run.scenario.disturbance.bound * run.tube_bound
    late = run.time > 0.05
    assert np.all(run.tube_deviation[late, :4] <= 1.01 * bound[late, :4] + 1e-5)
    assert np.max(run.tube_deviation[late, :4] / bound[late, :4]) > 0.1


def test_the_reading_is_the_felt_force_in_the_tips_axes(run):
    """As of this sensor, which is mounted there; after the tare, which reads zero."""
    model = uv.ContactModel.load(run.scenario.model, check_surface(run.scenario.surface))
    A_E = model.kinematics(run.config).A_E
    in_tip = (run.signals["force_measured"][:, None] @ A_E)[:, 0]
    np.testing.assert_allclose(run.signals["force_raw"], in_tip, atol=1e-9)
    tared = run.time < 0.195
    assert not np.any(in_tip[tared])
    assert np.all(np.any(in_tip[run.time > 0.21], axis=1))


def test_a_scenarios_seed_is_that_of_the_sensor():
    readings = [uv.simulate(replace(scenario_of(0.4), seed=seed)).signals["force_raw"]
                for seed in (1, 1, 2)]
    np.testing.assert_array_equal(*readings[:2])
    assert np.max(np.abs(readings[0] - readings[2])) > 0.1


# Faults ------------------------------------------------------------------------------------------


START, END = 1.5, 2.0


@pytest.mark.parametrize(("fault", "expected"), [
    (LostForce(START), "held"),
    pytest.param(FrozenForce(START), "held", marks=pytest.mark.long),
    pytest.param(SaturatedForce(START, largest=4.0), "cut", marks=pytest.mark.long),
    (JumpedForce(START), "jumped")])
def test_a_fault_of_the_sensor_changes_what_is_felt_while_it_lasts(fault, expected):
    record = uv.simulate(scenario_of(2.5, "log_period=0.01", faults=[fault]))
    felt, measured = (record.signals[name] for name in ("force_last_valid", "force_measured"))
    faulty = (record.time > START + 1e-6) & (record.time < END - 1e-6)
    right = (record.time < START - 1e-6) | (record.time > END + 1e-6)
    np.testing.assert_array_equal(felt[right], measured[right])
    if expected == "held":
        assert np.all(felt[faulty] == felt[faulty][0])
        before = measured[(record.time > START - 0.025) & (record.time < START + 1e-6)]
        assert np.min(np.max(np.abs(felt[faulty][0] - before), axis=1)) < 1e-9
    else:
        made = np.clip(measured, -4.0, 4.0) if expected == "cut" else measured + fault.jump
        np.testing.assert_allclose(felt[faulty], made[faulty], atol=1e-12)
    for name in ("state", "u", "tau", "force"):
        assert np.all(np.isfinite(getattr(record, name)))
    assert np.all(np.abs(record.u) <= record.scenario.limits.u)
    error = np.linalg.norm(record.force[-1] - record.desired_force[-1])
    assert error < record.scenario.task.force_tolerance
    assert "faults, which the proofs do not cover" in given_up(record.scenario)


def test_a_sensor_that_never_knows_is_one_that_feels_nothing():
    """Without any finite value there is none to go on with but zero."""
    lost, nothing = (uv.simulate(scenario_of(0.6, sensing=[part]))
                     for part in (NoForce(np.nan), NoForce(0.0)))
    np.testing.assert_array_equal(lost.state, nothing.state)


def test_a_lost_state_does_not_take_the_force_along():
    record = uv.simulate(uv.load_scenario("girona500_ideal", [
        "duration=2", CLOSE, "sensing=[!ForceSensor {tare: 0.2}]",
        "faults=[!LostState {start: 1.2, duration: 0.3}]"]))
    lost = record.state_lost > 0.0
    felt = record.signals["force_last_valid"]
    assert np.all(np.isfinite(felt))
    assert np.all(felt[lost] == felt[lost][0])
    assert felt[lost][0, 0] > 5.0


# What is refused ---------------------------------------------------------------------------------


# A force sensor that fails while the robot presses by what it feels: the whole closed loop.


WALL = "surface.geometry.point.0=0.01"


@pytest.mark.long
@pytest.mark.parametrize(("fault", "start", "end"), [
    ("!LostForce {start: 3.0, duration: 1.0}", 3.0, 4.0),
    ("!FrozenForce {start: 1.0, duration: 1.5}", 1.0, 2.5),
])
def test_it_retreats_presses_no_harder_and_goes_on_by_itself(fault, start, end):
    """While it presses, and before it touches; without the supervisor, which retreats for good."""
    scenario = close_to_the_wall(
        WALL, "duration=8.5", "log_period=0.01", f"faults=[{fault}]", "supervisor=null")
    record = uv.simulate(scenario)
    contact, felt = sensed_contact(scenario), record.signals["force_last_valid"]
    static = true_surface(scenario).static_force(record.chi)
    assert static.max() <= contact.force
    assert np.all(record.mpc_status == 0.0)
    assert max(record.mpc_violation.max(), record.mpc_terminal_slack.max()) <= 1e-6
    lost = record.signals["force_lost"][:, 0] > 0.0
    assert start < record.time[lost][0] < start + 0.9
    assert not np.any(lost[record.time > end + 0.05])
    assert np.mean(np.any(felt[lost], axis=1)) < 0.1, "but for samples at which it comes back"
    retreats = [event for event in events(record) if event.kind == "force_lost"]
    assert record.time[lost][0] == retreats[0].start
    assert retreats[-1].end is not None
    assert static[-1] > 4.0, "it is back on its way to the desired force"


def test_who_feels_nothing_any_more_has_no_force_in_the_law_and_goes_back():
    """Soon after the tare, off the wall; and the front stays where it was."""
    scenario = close_to_the_wall(
        "duration=1.2", "log_period=0.01", "faults=[!FrozenForce {start: 0.6, duration: 9}]")
    record = uv.simulate(scenario)
    lost = record.signals["force_lost"][:, 0] > 0.0
    x = record.chi[:, 0]
    at = np.argmax(lost)
    assert record.time[at] == pytest.approx(0.6 + 0.01 * (4 + 10), abs=0.021)
    assert np.all(lost[at:])
    assert not np.any(record.signals["force_last_valid"][lost])
    held = record.signals["force_last_valid"][(record.time > 0.61) & ~lost]
    assert np.all(held == held[0]) and np.all(held[0] != 0.0)
    y, tilt = record.chi[lost, 1:3], sensed_contact(scenario).walls.tilt
    aside = np.max(np.sum(np.abs(y - y[0]), axis=1))  # The front is a pyramid.
    assert np.ptp(record.signals["safe_depth"][lost]) <= 1.2 * tilt * aside
    target = record.signals["target"][lost, 0]
    assert np.ptp(target) == 0.0
    a_sample = scenario.mpc.time_step * np.max(np.gradient(x, record.time))
    assert target[0] == pytest.approx(x[at] - 0.05, abs=a_sample)
    assert record.nominal_zeta[-1, 0] < 0.0 < np.max(record.nominal_zeta[:, 0])
