"""Faults of thrusters: the forces during them, by hand; the limit of the current; bad input."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from support.refusals import refusals
from support.runs import simulated
from support.scripts import Script, use_fixed_steps
from support.thrusters import eight_thrusters

import uvms_drake as uv
from uvms_drake.actuation.thruster_faults import (
    ExchangedThrusters,
    LostThruster,
    ReversedThruster,
    StuckThruster,
)
from uvms_drake.actuation.thruster_systems import ThrusterDynamics
from uvms_drake.model.propulsion.allocation import Allocation
from uvms_drake.model.propulsion.thrusters import ThrusterModel
from uvms_drake.sensing.faults import JumpedPosition, MiscalibratedForce

THRUSTERS = ThrusterModel.of(eight_thrusters())
FORCES = np.array([20.0, -11.0, 7.0, 3.0, -5.0, 9.0, -2.0, 13.0])
ACROSS1, UP1 = THRUSTERS.names.index("across1"), THRUSTERS.names.index("up1")


def changed(**forces):
    """Returns FORCES with some of them changed, by the thrusters' names."""
    out = FORCES.copy()
    for name, force in forces.items():
        out[THRUSTERS.names.index(name)] = force
    return out


@pytest.mark.parametrize(("fault", "during"), [
    (LostThruster("across1", 1.0), changed(across1=0.0)),
    (StuckThruster("up1", 1.0, share=0.5), changed(up1=0.5 * THRUSTERS.upper[UP1])),
    (StuckThruster("up1", 1.0, share=-0.25), changed(up1=0.25 * THRUSTERS.lower[UP1])),
    (ReversedThruster("across1", 1.0), changed(across1=-FORCES[ACROSS1])),
    (ExchangedThrusters("across1", 1.0, other="up1"),
     changed(across1=FORCES[UP1], up1=FORCES[ACROSS1])),
])
def test_the_forces_during_a_fault(fault, during):
    """The commanded ones before it, and one time constant after it on the way to the others."""
    builder = DiagramBuilder()
    source = builder.AddSystem(Script(command=lambda t: THRUSTERS.commands_of(FORCES)))
    command = source.get_output_port()
    dynamics = ThrusterDynamics.AddToBuilder(
        builder, THRUSTERS, 0.01, 0, command=fault.add_to(builder, THRUSTERS, command),
        hover=command)
    builder.ExportOutput(dynamics.get_output_port(), "force")
    diagram = builder.Build()
    simulator = Simulator(diagram)
    use_fixed_steps(simulator)
    simulator.AdvanceTo(1.0)
    force = diagram.get_output_port().Eval
    np.testing.assert_allclose(force(simulator.get_context()), FORCES, atol=1e-9)
    simulator.AdvanceTo(1.0 + 0.01 + 0.15)  # One sample and one time constant.
    np.testing.assert_allclose(force(simulator.get_context()),
                               during + (FORCES - during) * np.exp(-1.0), atol=0.01)
    simulator.AdvanceTo(4.0)
    np.testing.assert_allclose(force(simulator.get_context()), during, atol=1e-6)


def test_a_thruster_sticks_where_it_is_and_a_reversed_one_is_as_weak_as_its_other_sense():
    """Backwards the thruster of the table is the weaker one."""
    now, kept = THRUSTERS.commands_of(FORCES), THRUSTERS.commands_of(-0.5 * FORCES)
    stuck = THRUSTERS.forces_of(StuckThruster("up1").sent(THRUSTERS, now, kept))
    np.testing.assert_allclose(stuck, changed(up1=-0.5 * FORCES[UP1]), atol=1e-9)
    full = THRUSTERS.commands_of(THRUSTERS.upper)
    reverse = THRUSTERS.forces_of(ReversedThruster("up1").sent(THRUSTERS, full, full))
    assert reverse[UP1] == pytest.approx(THRUSTERS.lower[UP1])


def test_beyond_the_largest_current_all_forces_are_reduced_by_one_factor():
    """Until the sum of I ∝ |f|^(3/2) is the largest current."""
    kind = eight_thrusters().kinds["t200"]
    kind.current = 24.0
    parameters = eight_thrusters()
    parameters.kinds["t200"] = kind
    free = ThrusterModel.of(parameters)
    limited = type(free)(**{**vars(free), "largest_current": 8.0})
    commands = free.commands_of(FORCES)
    forces, reduced = free.forces_of(commands), limited.forces_of(commands)
    ratio = reduced / forces
    np.testing.assert_allclose(ratio, ratio[0])
    assert ratio[0] < 0.95
    each = 24.0 * (np.abs(reduced) / free.upper) ** 1.5
    assert np.sum(each) == pytest.approx(8.0)
    np.testing.assert_array_equal(limited.forces_of(free.commands_of(0.2 * FORCES)),
                                  free.forces_of(free.commands_of(0.2 * FORCES)))
    # A dead one takes none; the rest of a wrench is what the current does not give.
    dead = limited.off_by(np.append(-1.0, np.zeros(7)))
    kept = dead.forces_of(commands)
    assert kept[0] == 0.0 and ratio[0] < kept[1] / forces[1] < 1.0
    wrench = free.B @ Allocation.to(free).forces(free.B @ FORCES)
    np.testing.assert_allclose(Allocation.to(free).shortfall(wrench), 0.0, atol=1e-9)
    short = Allocation.to(limited).shortfall(wrench)
    share = np.linalg.norm(short) / np.linalg.norm(wrench)
    np.testing.assert_allclose(short, share * wrench, atol=1e-6)
    used = 24.0 * ((1.0 - share) * np.abs(Allocation.to(free).forces(wrench)) / free.upper) ** 1.5
    assert np.sum(used) == pytest.approx(8.0)


def test_a_force_sensor_of_other_gains_with_cross_talk():
    force = np.array([10.0, 2.0, -4.0, 1.0, 0.5, -0.5])
    gain = np.array([0.1, 0.0, -0.2, 0.0, 0.0, 0.0])
    wrong = MiscalibratedForce(gain=gain, crosstalk=0.05).faulty(force, force)
    np.testing.assert_allclose(wrong, [11.0 - 0.1, 2.0 + 0.3, -3.2 + 0.6, 1.0, 0.525, -0.425])


def test_a_jump_of_the_position_leaves_the_other_components():
    state = np.arange(20.0)
    jumped = JumpedPosition(jump=np.array([0.1, -0.2, 0.3])).faulty(state, state)
    np.testing.assert_allclose(jumped - state, [0.1, -0.2, 0.3, *np.zeros(17)], atol=1e-12)


LOOP = "girona500_real_loop"
test_bad_input = refusals(LOOP, {
    "faults=[!LostThruster {thruster: bow_thruster}]":
        r"^faults\[0\]\.thruster = 'bow_thruster': must be one of ",
    "faults=[!StuckThruster {thruster: x, share: 1.5}]": r"faults\[0\]\.share",
    "faults=[!LostThruster {thruster: x, start: -1}]": r"faults\[0\]\.start",
    "faults=[!ExchangedThrusters {thruster: x, other: x}]": r"faults\[0\]\.other",
    "actuation.1.error=[-2]": r"actuation\[1\]\.error .*ReversedThruster",
    "actuation.1.error=[1]": r"actuation\[1\]\.error",
    "actuation.1.largest_current=0": r"actuation\[1\]\.largest_current",
    "actuation.1.largest_current=20": r"largest_current = 20.*has no current",
    "faults=[!JumpedPosition {jump: [1]}]": r"faults\[0\]\.jump",
    "faults=[!MiscalibratedForce {gain: [1]}]": r"faults\[0\]\.gain",
}, uv.make_station)
test_without_thrusters = refusals("girona500_contact", {
    "faults=[!LostThruster {thruster: bow}]": r"faults\[0\] = .*no !Thrusters"}, uv.make_station)


def run(overrides):
    """Returns the record of a second of the real loop with faults."""
    return simulated("bluerov2_real_loop", 1.0, *overrides)


@pytest.mark.long
def test_a_dead_thruster_gives_no_force_in_a_run_and_the_model_does_not_know():
    """It decays with its lag; by a relative error of −1 it gives none from the first sample on."""
    healthy, lost, dead, weak = map(run, (
        (), ("faults=[!LostThruster {thruster: stern_port, start: 0.3}]",),
        ("actuation.1.error=[-1,0,0,0,0,0,0,0]",), ("actuation.1.largest_current=0.5",)))
    before = lost.time <= 0.3
    np.testing.assert_array_equal(lost.signals["thruster_force"][before],
                                  healthy.signals["thruster_force"][before])
    force = np.abs(lost.signals["thruster_force"])
    assert force[-1, 3] < 0.05 * force[15, 3] and np.all(force[-1, [0, 1, 2]] > 0.1)
    assert np.max(np.abs(dead.signals["thruster_force"][30:, 0])) < 0.2
    total = 24.0 * (np.abs(weak.signals["thruster_force"]) / 51.48) ** 1.5
    assert np.max(np.sum(total, axis=1)) < 0.55
    assert np.sum(24.0 * (force[10] / 51.48) ** 1.5) > 0.6


@pytest.mark.slow
def test_a_jump_of_the_position_and_a_wrong_depth_are_measured_in_a_run():
    """From the instants on at which they begin."""
    jumped = run(("faults=[!JumpedPosition {start: 0.5, duration: 9, jump: [0.0, 0, 0.01]}, "
                  "!MiscalibratedForce {start: 0.6, duration: 9, depth: [1000,0,0,0,0,0]}]",))
    off = jumped.signals["measured_state"][:, 2] - jumped.state[:, 2]
    before = jumped.time <= 0.5
    assert np.max(np.abs(off[before])) < 0.002  # Of the navigation alone.
    np.testing.assert_allclose(off[~before], 0.01, atol=0.002)
    force, z = jumped.signals["force_last_valid"][:, 0], jumped.model.task_pose(
        jumped.state[:, : jumped.model.size])[:, 2]
    at = int(np.searchsorted(jumped.time, 0.6)) + 1
    change = force[at:] - jumped.signals["force_measured"][at:, 0]
    np.testing.assert_allclose(change, 1000.0 * (z[at:] - z[at - 1]), atol=0.5)
