"""The law of a worst-case certificate reads the present state, as its theory says; no older one."""

import numpy as np
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator

import uvms_drake as uv

TICK = 2.0**-8
"""Time between two samples of this test [s]."""


def test_the_law_of_a_certificate_reads_the_present_state():
    scenario = uv.with_step(uv.load_scenario("girona500_tip_first"))
    station = uv.make_station(scenario)
    simulator = Simulator(station)
    ApplySimulatorConfig(scenario.simulator, simulator)
    root = simulator.get_context()

    def value(system: str, port: str) -> np.ndarray:
        """Returns the present value of a port of a subsystem."""
        part = station.GetSubsystemByName(system)
        return part.GetOutputPort(port).Eval(part.GetMyContextFromRoot(root)).copy()

    controller = station.GetSubsystemByName("tube_mpc")
    for tick in (35, 69):  # Just after a plan, and on the way.
        simulator.AdvanceTo(tick * TICK)
        read = controller.GetInputPort("state").Eval(controller.GetMyContextFromRoot(root))
        assert np.any(read[len(read) // 2:]), "it moves"
        assert np.array_equal(read, value("uvms", "state"))
        due = value("tube_mpc", "tau")
        simulator.AdvanceTo((tick + 0.5) * TICK)
        assert np.max(np.abs(value("tube_mpc", "tau") - due)) > 0.01, "half a period is told apart"
