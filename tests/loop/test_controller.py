"""The controller in a loop of one's own: equal to `simulate`, and safe for whatever comes."""

import gc
import re
from dataclasses import MISSING, fields
from signal import SIGSTOP

import numpy as np
import pytest
from support.own_loop import own_loop

import uvms_drake as uv
from uvms_drake.certificate.certificate import Certificate
from uvms_drake.loop.command import Mode
from uvms_drake.loop.planner_process import ENDED
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.model.signals.sensor_actuator import CAUSES
from uvms_drake.model.uvms_model import configuration_rate_matrix

EXACT = ["log_period=0.015625", "mpc.time_step=0.1875"]
"""Periods in powers of two, of which all clocks agree to the last digit."""
SENSED = [*EXACT, "sensing=[!ForceSensor {rate: 64.0}]", "contact.period=0.015625"]
CLOCK = "!SampledCommand {period: 0.015625, delay: 0.0}"
DELAYED = "!SampledCommand {period: 0.015625, delay: 0.0078125}"
OBSERVED = ["ancillary.vehicle.observer=1.0", "ancillary.tip.observer=3.0",
            "ancillary.observer_period=0.015625"]
THRUSTERS = "!Thrusters {period: 0.015625, lag: 0.15, dead_time: 0.046875}"


@pytest.mark.parametrize(("name", "more", "duration", "wait"), [
    ("girona500_ideal", [*EXACT, f"actuation=[{DELAYED}, !IdealWrench {{undriven: [roll]}}]"],
     0.5, None),
    ("girona500_ideal", [*EXACT, f"actuation=[{CLOCK}, !IdealWrench {{undriven: [roll]}}]",
                         "mpc.in_advance=true"], 0.8, np.inf),
    pytest.param("girona500_contact", [*SENSED, f"actuation=[{CLOCK}]", "start.eta.0=-1.25"],
                 3.0, None, marks=pytest.mark.slow),
    pytest.param("girona500_contact", [*SENSED, f"actuation=[{CLOCK}]", "start.eta.0=-1.25",
                                       "mpc.in_advance=true"], 2.0, np.inf, marks=pytest.mark.slow),
    pytest.param("girona500_tip_first", [*SENSED, f"actuation=[{CLOCK}]", *OBSERVED],
                 1.0, None, marks=pytest.mark.slow),
    pytest.param("girona500_real_loop", [
        *SENSED, "current=[0, 0, 0]", f"actuation=[{DELAYED}, {THRUSTERS}]", "mpc.hover=0.75",
        OBSERVED[-1]], 2.0, None, marks=pytest.mark.slow)])
def test_at_regular_times_it_equals_simulate_bit_for_bit(name, more, duration, wait):
    scenario = uv.load_scenario(name, [*more, f"duration={duration}"])
    rows, record = own_loop(scenario, duration, wait=wait), uv.simulate(scenario)
    at = np.searchsorted(rows.time, record.time - 1e-9)[:-1]  # Of the last instant there is none.
    np.testing.assert_array_equal(rows.time[at], record.time[:-1])
    np.testing.assert_array_equal(rows.state[at], record.state[:-1])
    if DELAYED not in str(more):  # Else the log has the command before.
        np.testing.assert_array_equal(rows.tau[at], record.signals["zoh_command"][1:])
    assert not any(command.alarms for command in rows.commands)


@pytest.fixture(scope="module")
def controller():
    return uv.Controller(uv.load_scenario("girona500_contact", ["supervisor=null"]), period=0.01)


@pytest.fixture
def started(controller):
    controller.reset(rest(controller))
    return controller


def rest(controller) -> np.ndarray:
    config = controller.scenario.start.config
    return np.concatenate([config, np.zeros_like(config)])


# What comes at a tick: time since the last one in periods, whether its samples are of use, and
# the mode that is documented for it.
COMES = {
    "regular": (1.0, True, Mode.RUNNING), "early": (0.3, True, Mode.RUNNING),
    "late": (7.3, True, Mode.RUNNING), "missing": (1.0, None, Mode.RUNNING),
    "nan": (1.0, np.nan, Mode.RUNNING), "wrong size": (1.0, np.zeros(3), Mode.RUNNING),
    "text": (1.0, "no state", Mode.RUNNING), "repeated": (0.0, True, Mode.REPEATED),
    "out of order": (-2.6, True, Mode.REPEATED), "no time": (np.nan, True, Mode.REPEATED),
    "never": (np.inf, True, Mode.REPEATED)}


def within_limits(controller, command) -> bool:
    """Returns whether τ is finite and of a u within limits, as far as the state is the start's."""
    limits, model = controller.scenario.limits, controller.model
    M = model.mass_matrix(model.kinematics(controller.scenario.start.config))
    u = np.linalg.solve(M, command.tau)
    return bool(np.isfinite(command.tau).all() and (np.abs(u) <= 1.001 * np.array(limits.u)).all())


def random_pattern(controller, seed: int) -> None:
    """Sends samples in a random pattern, and checks each outcome against the table above."""
    rng, state = np.random.default_rng(seed), rest(controller)
    controller.reset(state)
    time = rng.uniform(-10.0, 1e9)
    assert controller.step(time, state, np.zeros(6)).mode == Mode.RUNNING
    last = time
    for kind in rng.choice(list(COMES), size=12):
        periods, usable, mode = COMES[kind]
        time = last + periods * 0.01
        given = state + 1e-4 * rng.standard_normal(20) if usable is True else usable
        if usable is np.nan:
            given = np.where(np.arange(20) == rng.integers(20), np.nan, state)
        command = controller.step(time, given, None if rng.random() < 0.2 else 0.1 * np.ones(6))
        assert within_limits(controller, command), (seed, kind)
        assert command.mode == mode, (seed, kind, command.alarms)
        assert mode == Mode.RUNNING or command.time == last, (seed, kind)
        assert bool(command.alarms) or kind in ("regular", "early"), (seed, kind)
        if mode == Mode.RUNNING:
            last = time


@pytest.fixture
def again_and_again(controller, monkeypatch):
    """The controller, whose first plan, always from the same state, is made only once."""
    planner, made = controller._mpc.planner, []
    first = planner.first
    monkeypatch.setattr(planner, "first",
                        lambda sample: made[0] if made else made.append(first(sample)) or made[0])
    return controller


def test_random_patterns_of_samples_have_the_documented_outcomes(again_and_again):
    for seed in range(50):
        random_pattern(again_and_again, seed)


@pytest.mark.long
def test_a_thousand_patterns(again_and_again):
    for seed in range(1000, 2000):
        random_pattern(again_and_again, seed)


def test_a_late_tick_tells_so_and_a_too_late_one_stops_until_reset(started):
    state, no_force = rest(started), np.zeros(6)
    started.step(0.0, state, no_force)
    late = started.step(0.1, state, no_force)
    assert late.mode == Mode.RUNNING and late.alarms[0].startswith("late: 0.1 s")
    stopped = started.step(0.7, state, no_force)
    assert stopped.mode == Mode.STOPPED and stopped.alarms == ("stopped: no sample for 0.6 s",)
    np.testing.assert_allclose(stopped.tau, equilibrium(started, state), rtol=1e-9, atol=1e-9)
    again = started.step(0.71, state, no_force)
    assert again.mode == Mode.STOPPED and again.time == 0.71
    started.reset(state)
    assert started.step(0.72, state, no_force).mode == Mode.RUNNING


def equilibrium(controller, state) -> np.ndarray:
    """Returns τ (10,) of rest at a state, without contact."""
    model, rest = controller.model, np.zeros(10)
    return model.inverse_dynamics(model.kinematics(state[:10]), rest, rest, np.zeros(6))


def stop(controller) -> np.ndarray:
    """Stops a controller at time 1.0, and returns the state of the place it keeps."""
    state = rest(controller)
    controller.step(0.0, state, np.zeros(6))
    assert controller.step(1.0, state, np.zeros(6)).mode == Mode.STOPPED
    return state


def test_stopped_it_drives_back_to_its_place_within_limits(started):
    place = stop(started)
    off = place.copy()
    off[0] += 0.2
    command = started.step(1.01, off)
    assert command.tau[0] < equilibrium(started, off)[0] - 50.0  # [N], back along x.
    assert within_limits(started, command) and len(command.alarms) == 1
    # The body of the model under these commands comes back, and is at rest there.
    model, state, T = started.model, place.copy(), started.period
    state[[0, 7]] += 0.02, 0.02
    for k in range(600):
        tau = started.step(1.02 + T * k, state).tau
        kinematics = model.kinematics(state[:10])
        bias = model.inverse_dynamics(kinematics, state[10:], np.zeros(10), np.zeros(6))
        state[10:] += T * np.linalg.solve(model.mass_matrix(kinematics), tau - bias)
        state[:10] += T * configuration_rate_matrix(state[:10]) @ state[10:]
    np.testing.assert_allclose(state, place, atol=1e-3)


@pytest.mark.parametrize(("time", "state"), [
    (1.01, None), (1.01, np.full(20, np.nan)), (1.0, 0.2), (np.nan, 0.2), ("now", 0.2)])
def test_stopped_without_a_new_state_it_gives_the_equilibrium_of_its_place(started, time, state):
    place = stop(started)
    command = started.step(time, place + state if isinstance(state, float) else state)
    np.testing.assert_allclose(command.tau, equilibrium(started, place), rtol=1e-9, atol=1e-9)
    assert command.mode == Mode.STOPPED
    assert command.alarms == ("stopped: no sample for 1 s", "without a state: open loop")


def test_the_time_in_set_task_is_no_gap_and_only_once(started, monkeypatch):
    state = rest(started)
    started.step(0.0, state, np.zeros(6))
    clock = iter([7.0, 7.3])
    monkeypatch.setattr("uvms_drake.loop.controller.perf_counter", lambda: next(clock))
    started.set_task(force=[12.0, 0, 0, 0, 0, 0])
    late = started.step(0.6, state, np.zeros(6))
    assert late.mode == Mode.RUNNING and late.alarms[0].startswith("late: 0.6 s")
    assert started.step(1.2, state, np.zeros(6)).mode == Mode.STOPPED


@pytest.fixture(scope="module")
def supervised():
    return uv.Controller(uv.load_scenario("girona500_contact"), period=0.01)


def test_a_retreat_of_the_supervisor_is_a_mode_with_its_cause(supervised):
    controller = supervised
    controller.reset(rest(controller))
    before = controller.step(0.0, rest(controller), np.zeros(6))
    assert before.mode == Mode.RUNNING and not before.alarms
    hard = [controller.step(0.01 * k, rest(controller), [60.0 + 0.1 * k, 0, 0, 0, 0, 0])
            for k in range(1, 6)][-1]
    assert hard.mode == Mode.RETREATING
    cause = list(CAUSES)[int(controller.signal("safety")[1]) - 1]
    assert cause in ("force", "slope")  # 60 N of a wall that declares 45, and where there is none.
    assert f"retreats: {cause}: {CAUSES[cause]}" in hard.alarms


def test_a_thruster_without_power_gets_no_force_and_the_others_give_the_wrench(monkeypatch):
    """Also when the loop is stopped afterwards; a reset gives it its power again."""
    scenario = uv.load_scenario("girona500_real_loop", ["mpc.hover=0.0"])
    controller = uv.Controller(scenario)
    state = rest(controller)
    controller.reset(state)
    whole = controller.step(0.0, state, np.zeros(6))
    assert whole.isolated == 0 and whole.thruster_forces[1] != 0.0
    of = controller.signal
    monkeypatch.setattr(controller, "signal", lambda name: np.array(
        [1.0, 7.0, 0.0, np.nan, 2.0]) if name == "safety" else of(name))
    command = controller.step(0.02, state, np.zeros(6))
    assert command.isolated == 2 and "thruster 2 is without power" in command.alarms
    thrusters = Allocation.to(ThrusterModel.of(controller.model.thrusters))
    assert command.thruster_forces[1] == 0.0
    np.testing.assert_allclose(np.delete(command.thruster_forces, 1),
                               thrusters.others[1].forces(command.tau[:6]))
    np.testing.assert_allclose(thrusters.thrusters.forces_of(command.thruster_commands),
                               command.thruster_forces, atol=1e-9)
    stopped = controller.step(9.0, state, np.zeros(6))
    assert stopped.mode == Mode.STOPPED and stopped.isolated == 2
    assert stopped.thruster_forces[1] == 0.0
    monkeypatch.undo()
    controller.reset(state)
    assert controller.step(0.0, state, np.zeros(6)).isolated == 0


def test_joints_move_under_the_present_wrench_of_the_thrusters():
    """It is not the commanded one at the start of a motion, with 0.2 s of delay."""
    controller = uv.Controller(uv.load_scenario("girona500_real_loop", ["mpc.hover=0.0"]))
    state, model = rest(controller), controller.model
    controller.reset(state)
    for k in range(12):
        command = controller.step(controller.period * k, state, np.zeros(6))
    wrench = controller.signal("vehicle_wrench")
    assert np.abs(wrench - command.tau[:6]).max() > 1.0
    rate = (command.joints.velocity - state[16:]) / controller.period
    # Newton's law of the whole robot: M ζ̇ + b = (τ_v, τ_q), in the rows of the joints.
    kinematics = model.kinematics(state[:10])
    M, b = model.mass_matrix(kinematics), equilibrium(controller, state)
    vehicle = np.linalg.solve(M[:6, :6], wrench - b[:6] - M[:6, 6:] @ rate)
    np.testing.assert_allclose(M[6:, :6] @ vehicle + M[6:, 6:] @ rate + b[6:], command.tau[6:],
                               atol=1e-6)


def test_a_lost_state_and_a_clock_that_stands_stop_it_after_the_longest_gap(started):
    state = rest(started)
    started.step(0.0, state)
    modes = [started.step(0.01 * k, None).mode for k in range(1, 60)]
    assert modes == [Mode.RUNNING] * 50 + [Mode.STOPPED] * 9
    started.reset(state)
    started.step(5.0, state)
    modes = [started.step(5.0 - 0.01 * k, state).mode for k in range(1, 60)]
    assert modes == [Mode.REPEATED] * 50 + [Mode.STOPPED] * 9


def test_without_a_state_the_command_is_the_plans_own(started):
    """It is the law's about no deviation: that of the nominal state as the measured one."""
    commands, nominal = [], None
    for _ in range(2):
        started.reset(rest(started))
        started.step(0.0, rest(started), np.zeros(6))
        commands.append(started.step(0.01, nominal, np.zeros(6)).tau)
        nominal = started.signal("nominal_state").copy()
    np.testing.assert_allclose(*commands, rtol=1e-9, atol=1e-9)


def test_a_failure_inside_is_a_stop_and_no_exception(started, monkeypatch):
    started.step(0.0, rest(started), np.zeros(6))
    monkeypatch.setattr("uvms_drake.loop.controller.alarms_of", lambda signals: 1 / 0)
    command = started.step(0.01, rest(started), np.zeros(6))
    assert command.mode == Mode.STOPPED
    assert command.alarms == ("stopped: it failed: division by zero",)


def test_a_state_beyond_all_measure_does_not_make_a_command_that_is_no_number(started):
    started.step(0.0, rest(started), np.zeros(6))
    commands = [started.step(0.01 * k, np.full(20, 1e120), np.zeros(6)) for k in range(1, 4)]
    assert all(np.isfinite(command.tau).all() and command.alarms for command in commands)


@pytest.fixture(scope="module")
def ideal():
    """Controllers that plan within a step: at once, and in advance."""
    return {how: uv.Controller(uv.load_scenario(
        "girona500_ideal", [f"mpc.in_advance={str(how == 'in advance').lower()}"]))
        for how in ("at once", "in advance")}


@pytest.mark.parametrize("how", ["at once", "in advance"])
def test_an_exception_of_the_planner_is_a_failed_sample_and_the_last_plan_goes_on(
        ideal, how, monkeypatch, caplog):
    controller = ideal[how]
    planner, state = controller._mpc.planner, rest(controller)
    controller.reset(state)
    rows, nominal = [], []
    for k in range(60):
        if k == 15:
            monkeypatch.setattr(planner, "again", lambda sample, memory: [][sample])
        if k == 35:
            monkeypatch.undo()
        rows.append(controller.step(0.02 * k, state))
        nominal.append(controller.signal("nominal_state").copy())
    assert all(row.mode == Mode.RUNNING and within_limits(controller, row) for row in rows)
    failed = [k for k, row in enumerate(rows) if "the solver failed" in row.alarms]
    assert failed and failed[0] >= 15 and failed[-1] < 50
    assert "no plan: TypeError: list indices" in caplog.text
    # The motion goes on without a jump, and is planned again: the nominal velocity is continuous.
    speeds = np.array(nominal)[:, 10:]
    assert np.max(np.abs(np.diff(speeds, axis=0))) < 0.02 * np.max(controller.scenario.limits.u)
    assert controller.signal("report")[:2] == pytest.approx([1.0, 0.0])


@pytest.mark.parametrize(("age", "mode"), [
    (None, Mode.RUNNING), (0.3, Mode.RUNNING), (0.6, Mode.RETREATING), (np.inf, Mode.RETREATING),
    (np.nan, Mode.RETREATING), ("old", Mode.RETREATING)])
def test_a_supervisor_gets_the_age_of_the_fix(supervised, age, mode):
    state, more = rest(supervised), {} if age is None else {"fix_age": age}
    supervised.reset(state)
    for k in range(3):
        command = supervised.step(0.01 * k, state, np.zeros(6), **more)
    assert command.mode == mode
    said = f"retreats: fix: {CAUSES['fix']}"
    assert command.alarms == () if mode == Mode.RUNNING else said in command.alarms


def test_without_a_supervisor_the_age_of_the_fix_is_not_read(started):
    state, without = rest(started), []
    for more in ({}, {"fix_age": 99.0}):
        started.reset(state)
        without.append(started.step(0.0, state, np.zeros(6), **more).tau)
    np.testing.assert_array_equal(*without)


def test_thrusters_and_joints_get_what_moves_them_so(started):
    state = rest(started)
    command = started.step(0.0, state, np.zeros(6))
    thrusters = started._outputs._allocation.thrusters
    np.testing.assert_allclose(thrusters.forces_of(command.thruster_commands),
                               command.thruster_forces, atol=1e-9)
    wrench = thrusters.B @ command.thruster_forces
    np.testing.assert_allclose(wrench[thrusters.driven], command.tau[thrusters.driven], atol=0.1)
    # The joints' acceleration is that of the drift plus u, and their motion its integral.
    model, T = started.model, started.period
    u = np.linalg.solve(model.mass_matrix(model.kinematics(state[:10])), command.tau)
    rate = (model.drift(state[:10], state[10:], np.zeros(6)) + u)[6:]
    np.testing.assert_allclose(command.joints.velocity, T * rate, atol=1e-9)
    np.testing.assert_allclose(command.joints.position, state[6:10] + 0.5 * T**2 * rate, atol=1e-9)
    np.testing.assert_array_equal(command.joints.torque, command.tau[6:])


def test_a_new_task_is_taken_at_the_next_step(started):
    started.step(0.0, rest(started), np.zeros(6))
    started.set_task(force=[12.0, 0, 0, 0, 0, 0], place=[0.0, 0.05, 0.1])
    started.step(0.01, rest(started), np.zeros(6))
    assert started.signal("desired_force")[0] == pytest.approx(12.0)
    assert started.signal("target")[1:] == pytest.approx([0.05, 0.1])


@pytest.mark.parametrize(("call", "text"), [
    (lambda c: c.reset(np.zeros(3)), "state = array.*must be 20 finite numbers|state = "),
    (lambda c: c.reset(np.full(20, np.nan)), "state = .*must be 20 finite numbers"),
    (lambda c: c.reset(np.append([0, 0, 0, 1.0, 0, 0], rest(c)[6:])), r"state\.start\.eta = "),
    (lambda c: c.set_task(force=[1.0]), "desired_force = .*must be 6 finite numbers"),
    (lambda c: c.set_task(place=[0, 0, np.nan]), "place = .*must be 3 finite numbers"),
    (lambda c: uv.Controller(c.scenario, longest_gap=0.001), "longest_gap = 0.001: must be more"),
    (lambda c: uv.Controller(c.scenario, wait=0.0), "mpc.in_advance = False: must be true"),
    (lambda c: uv.Controller(uv.load_scenario("girona500_contact"), period=0.05),
     r"contact\.period = 0\.01: must be at least"),
    (lambda c: uv.Controller(uv.load_scenario("girona500_ideal")).step(0.0), "reset = 'missing'"),
])
def test_bad_input_is_one_line(controller, call, text):
    with pytest.raises(uv.InvalidParameter, match=text) as caught:
        controller.reset(rest(controller))
        call(controller)
    assert "\n" not in str(caught.value)


def test_the_certificate_of_another_scenario_is_refused(controller):
    other = uv.load_scenario("girona500_ideal", ["disturbance.bound=0.01"])
    empty = Certificate(**{field.name: None for field in fields(Certificate) if (
        field.default is MISSING and field.default_factory is MISSING)})
    with pytest.raises(uv.InvalidParameter, match="certificate = "):
        uv.Controller(other, empty)


@pytest.mark.slow
def test_a_plan_that_is_not_ready_is_told_and_the_last_one_goes_on(monkeypatch):
    """No plan is ever ready: each sample but the first says so, and the first plan is followed."""
    scenario = uv.load_scenario("girona500_ideal", ["mpc.in_advance=true"])
    controller = uv.Controller(scenario, wait=0.0)
    controller.reset(rest(controller))
    monkeypatch.setattr(controller._computer, "result", lambda: None)
    commands = [controller.step(0.02 * k, rest(controller)) for k in range(45)]
    said = [bool(re.search("deadline", " ".join(command.alarms))) for command in commands]
    # The plan of 0.2 s is to come at 0.4 s; the alarm stays until one comes.
    assert not any(said[:20]) and all(said[21:])
    assert all(command.mode == Mode.RUNNING for command in commands)
    first, now = commands[5].plan, commands[-1].time
    np.testing.assert_allclose(commands[-1].plan.at(now)[0], first.at(now)[0], atol=1e-12)


@pytest.fixture(scope="module")
def beside():
    """Controller with a process for its plans, which each step waits for."""
    scenario = uv.load_scenario("girona500_ideal", ["mpc.in_advance=true"])
    with uv.Controller(scenario, wait=np.inf) as controller:
        yield controller
    assert controller._computer._process.poll() is not None  # Left, it has ended.
    with pytest.raises(uv.InvalidParameter, match="reset = 'missing'"):
        controller.step(0.0)


def alarms_of(controller, first: int, last: int) -> list[str]:
    commands = [controller.step(0.02 * k, rest(controller)) for k in range(first, last)]
    assert all(command.mode == Mode.RUNNING for command in commands)
    # The robot does not follow the plan here, which a limit tells after a while.
    return [alarm for command in commands for alarm in command.alarms if "a limit" not in alarm]


def test_a_dead_planner_is_told_the_last_plan_goes_on_and_reset_begins_it_again(beside):
    for _ in range(2):
        beside.reset(rest(beside))
        assert not alarms_of(beside, 0, 12)
        beside._computer._process.kill()
        beside._computer._process.wait()
        alarms = alarms_of(beside, 12, 45)
        assert ENDED in alarms and "the solver missed its deadline" in alarms
    beside.reset(rest(beside))
    assert not alarms_of(beside, 0, 32)


def test_whatever_a_planner_raises_is_a_failed_sample(beside):
    beside.reset(rest(beside))
    assert not alarms_of(beside, 0, 12)
    computer = beside._computer
    computer.result()
    computer.start(None, None)  # Of which no planner makes a plan.
    assert computer.result() is None and computer.trouble.startswith("no plan: AttributeError: ")
    alarms = alarms_of(beside, 12, 22)
    assert any(alarm.startswith("no plan: AttributeError") for alarm in alarms)
    alarms_of(beside, 22, 45)
    assert not alarms_of(beside, 45, 52)  # The next plan is one again.
    assert computer._process.poll() is None


def test_a_process_that_hangs_is_ended_and_goes_with_its_controller():
    controller = uv.Controller(uv.load_scenario("girona500_ideal", ["mpc.in_advance=true"]),
                               wait=0.0)
    controller.reset(rest(controller))
    process = controller._computer._process
    process.send_signal(SIGSTOP)  # It does not even read that the pipe is closed.
    del controller
    gc.collect()
    assert process.poll() is not None
