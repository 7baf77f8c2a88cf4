"""Tests of `uvms_drake.control.contact.desired_force`."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.control.contact.desired_force import DesiredForce

N = np.array([0.0, 0.6, 0.8])


def outputs(wanted: np.ndarray | None) -> tuple[np.ndarray, float]:
    system = DesiredForce(N, 12.0, 30.0)
    context = system.CreateDefaultContext()
    if wanted is not None:
        system.GetInputPort("desired_force").FixValue(context, wanted)
    along = system.GetOutputPort("along").Eval(context)
    return system.GetOutputPort("accepted_force").Eval(context), float(along[0])


@pytest.mark.parametrize(("force", "accepted"), [(20.0, 20.0), (40.0, 30.0), (-5.0, 0.0)])
def test_a_force_along_the_direction_is_cut_to_what_can_be_given(force: float, accepted: float):
    wrench, along = outputs(np.append(force * N, np.zeros(3)))
    assert along == pytest.approx(accepted)
    assert wrench == pytest.approx(np.append(accepted * N, np.zeros(3)))


def test_what_is_across_the_direction_is_left_out():
    wrench, along = outputs(np.append(10.0 * N + 3.0 * np.array([1.0, 0.0, 0.0]), np.ones(3)))
    assert along == pytest.approx(10.0)
    assert wrench == pytest.approx(np.append(10.0 * N, np.zeros(3)))


def test_without_a_wish_the_default_holds_and_one_that_is_not_finite_is_none():
    assert outputs(None)[1] == 12.0
    wrench, along = outputs(np.full(6, np.nan))
    assert along == 0.0
    assert not np.any(wrench)


def test_a_clipped_force_gives_one_warning_when_it_begins(caplog):
    builder = DiagramBuilder()
    forces = np.array([20.0, 45.0, 50.0, 20.0, np.nan, 20.0, -3.0])
    source = builder.AddSystem(TrajectorySource(PiecewisePolynomial.ZeroOrderHold(
        np.arange(8.0), np.outer(np.append(N, np.zeros(3)), np.append(forces, 20.0)))))
    system = DesiredForce.AddToBuilder(builder, N, 12.0, 30.0)
    builder.Connect(source.get_output_port(), system.GetInputPort("desired_force"))
    simulator = Simulator(builder.Build())
    for time in np.arange(0.25, 8.0, 0.25):
        simulator.AdvanceTo(time)
    cut, can = "the desired force is cut to", "along the direction from 0 to 30 N can be given"
    assert [record.message for record in caplog.records] == [
        f"t = 1 s: {cut} 30 N, {can}", "t = 4 s: the desired force is not finite: none is given",
        f"t = 6 s: {cut} 0 N, {can}"]


def test_a_desired_force_across_the_direction_gives_a_warning(caplog):
    system = DesiredForce(N, 12.0, 30.0)
    simulator = Simulator(system)
    system.GetInputPort("desired_force").FixValue(
        simulator.get_mutable_context(), [5.0, *(10.0 * N[1:]), 0.0, 0.0, 0.0])
    simulator.AdvanceTo(0.1)
    (record,) = caplog.records
    assert record.message == ("t = 0 s: of the desired force only the part along the direction is "
                              "given, 10 N")


def test_a_default_beyond_the_largest_is_refused():
    with pytest.raises(InvalidParameter, match="default"):
        DesiredForce(N, 31.0, 30.0)
