"""A controller of one's own in the closed loop of a station."""

import numpy as np
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem

import uvms_drake as uv
from uvms_drake.common.wiring import output_of


class Still(LeafSystem):
    """Holds the robot at its start by the model's gravity and stiff springs."""

    def __init__(self, model, config):
        super().__init__()
        size = model.size
        state = self.DeclareVectorInputPort("state", 2 * size)
        force = self.DeclareVectorInputPort("force_measured", 6)
        self.DeclareVectorInputPort("place", 3)

        def tau(context):
            y, zeta = np.split(state.Eval(context), 2)
            away = np.concatenate([config[:3] - y[:3], np.zeros(3), config[6:] - y[6:]])
            return -model.mass_matrix(model.kinematics(y)) @ (
                model.drift(y, zeta, np.zeros(6)) + 4.0 * zeta - 4.0 * away)

        output_of(self, "tau", size, tau, {state.ticket()})
        output_of(self, "seen", 6, force.Eval, {force.ticket()})


def test_a_controller_of_ones_own_is_wired_and_logged_by_the_names_of_its_ports():
    scenario = uv.load_scenario("girona500_contact", ["duration=1", "start.eta=[-1,0,0,0,0,0]"])
    model = uv.load_model(scenario)
    scenario = uv.with_step(scenario, model)
    station = uv.make_station(
        scenario, controller=Still(model, scenario.start.config), model=model)
    names = {station.get_input_port(i).get_name() for i in range(station.num_input_ports())}
    assert names == {"place"}
    simulator = Simulator(station)
    simulator.AdvanceTo(1.0)
    logs = uv.read_logs(station, simulator.get_context())
    assert {"state", "tau", "seen", "force_measured", "force_last_valid"} <= set(logs)
    assert not {"tube_bound", "mpc_time", "plan"} & set(logs)
    np.testing.assert_allclose(logs["state"][-1, :3], scenario.start.eta[:3], atol=0.05)
    np.testing.assert_array_equal(logs["seen"], logs["force_last_valid"])
