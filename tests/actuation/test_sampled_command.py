"""Tests of `uvms_drake.actuation.ideal`: the loop of a computer, against one by hand."""

from dataclasses import replace

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator

import uvms_drake as uv
from uvms_drake.actuation.ideal import SampledCommand
from uvms_drake.plant.disturbance import ConstantDisturbance
from uvms_drake.station.plant import make_simulated_uvms
from uvms_drake.station.tube_control import make_tube

PERIOD, DELAY = 1.0 / 64.0, 1.0 / 128.0
"""Sums of them are exact, so that events that are meant to be of one instant are."""
CLOSE = "start.eta=[-1.105, -0.05, -0.05, 0.02, 0.02, 0.05]"
STEP = "simulator.max_step_size=0.005"


def scenario_of(duration: float, *overrides: str, part=None):
    scenario = uv.load_scenario("girona500_ideal", [f"duration={duration}", CLOSE, STEP,
                                                 *overrides])
    return replace(scenario, actuation=[part or SampledCommand(PERIOD, DELAY)],
                   disturbance=ConstantDisturbance(0.05))


def by_hand(scenario, steps: int) -> list[np.ndarray]:
    """Returns the states at the ticks of a loop in Python around plant and controller."""
    model = uv.load_model(scenario)
    ocp = uv.make_ocp(scenario, model)
    uvms = make_simulated_uvms(scenario, scenario.disturbance, scenario.start.config)
    robot = Simulator(uvms)
    ApplySimulatorConfig(scenario.simulator, robot)
    controller = Simulator(make_tube(scenario, model, ocp))

    def state():
        return uvms.GetOutputPort("state").Eval(robot.get_context()).copy()

    def command(now):
        system, context = controller.get_system(), controller.get_mutable_context()
        system.GetInputPort("state").FixValue(context, state())
        controller.AdvanceTo(now)
        controller.AdvancePendingEvents()
        return system.GetOutputPort("tau").Eval(context).copy()

    def apply(tau):
        uvms.GetInputPort("tau").FixValue(robot.get_mutable_context(), tau)

    states = []
    for k in range(steps):
        states.append(state())
        tau = command(k * PERIOD)
        if k == 0:
            apply(tau)
        robot.AdvanceTo(k * PERIOD + DELAY)
        apply(tau)
        robot.AdvanceTo((k + 1) * PERIOD)
    return states


def test_the_loop_is_that_of_a_computer_bit_for_bit():
    """Over two plans that the MPC makes anew, and into the wall."""
    scenario = scenario_of(0.625, "mpc.time_step=0.25", f"log_period={PERIOD}")
    record = uv.simulate(scenario)
    np.testing.assert_array_equal(record.state[:-1], by_hand(scenario, 40))
    assert record.force[-1, 0] > 0.0


def test_the_law_runs_once_a_period_and_its_command_stays(monkeypatch):
    asked, command = [], uv.Resolved.command

    def counted(self, *args):
        asked.append(1)
        return command(self, *args)

    monkeypatch.setattr(uv.Resolved, "command", counted)
    record = uv.simulate(scenario_of(0.4, "log_period=0.01", part=SampledCommand(0.02, 0.012)))
    # Every 10 ms, for the log and for the tick, and at 0.2 s again, after a plan is made.
    assert len(asked) == 41 + 1
    sampled, tau = record.signals["zoh_command"], record.tau
    np.testing.assert_array_equal(sampled[0], tau[0])
    for k in range(1, 20):  # A log is made before the events of its instant.
        np.testing.assert_array_equal(sampled[2 * k], sampled[2 * k + 1])
        if k % 10:  # At 0.2 s the plan is made anew after the log.
            np.testing.assert_array_equal(sampled[2 * k + 2], tau[2 * k])
    assert np.all(np.any(np.diff(sampled[2::2], axis=0) != 0.0, axis=1))
    # The effect of the hold is no disturbance.
    np.testing.assert_allclose(record.effective_disturbance, record.disturbance, atol=1e-9)
