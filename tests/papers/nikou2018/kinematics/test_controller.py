"""Tests of `kinematics.controller`."""

from uvms_drake.control.laws import Resolved
from uvms_drake.papers.nikou2018.kinematics.controller import make_kinematic_tube_mpc
from uvms_drake.station.motions.motions import make_ocp
from uvms_drake.station.scenario.scenario import load_scenario


def ports_of(controller) -> tuple[dict[str, int], dict[str, int]]:
    """Returns the sizes of the input and of the output ports, by name."""
    inputs = [controller.get_input_port(i) for i in range(controller.num_input_ports())]
    outputs = [controller.get_output_port(i) for i in range(controller.num_output_ports())]
    return ({port.get_name(): port.size() for port in inputs},
            {port.get_name(): port.size() for port in outputs})


def test_it_has_the_documented_ports():
    ocp = make_ocp(load_scenario("paper_kinematic"))
    assert ports_of(make_kinematic_tube_mpc(ocp, Resolved())) == (
        {"configuration": 10, "fault": 1},
        {"u": 10, "state_lost": 1, "nominal_state": 20, "nominal_input": 10, "plan": 0, "report": 8,
         "solve_seconds": 1})
