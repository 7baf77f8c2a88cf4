"""Readings that repeat themselves within the bounds of the sensor's error are no frozen ones.

A component that is repeated on purpose, and sensors of a coarse resolution: the same behaviour as
that of the shipped sensor, without a reading lost. A sensor that freezes is found in time.
"""

from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput
from support.coarse_sensors import (
    SHARES,
    QuietForceSensor,
    RepeatedComponents,
    with_coarse_sensor,
)
from support.scripts import Script

import uvms_drake as uv
from uvms_drake.sensing.faults import FrozenForce
from uvms_drake.sensing.force_fault_detector import ForceFaultDetector, ForceStatus
from uvms_drake.sensing.force_sensor import error_bound
from uvms_drake.sensing.wrist_sensor import WristSensor
from uvms_drake.station.contact.bounds import (
    LONGEST_FREEZE,
    pressing_force,
    reading_of,
    sensed_contact,
    sensing_of,
)

SETTLED = {"girona500_contact": 12.0, "bluerov2_contact": 14.0, "girona500_stiff": 11.0}
"""Time at which the force has settled in each scenario [s]."""
NEARER = {"girona500_stiff": ["surface.geometry.point.0=-0.108", "contact.clearance=0.005"]}
"""Walls of a slow approach, as near as 8 mm."""
HOLD = 2.0
"""Time for which the force of the hold is looked at [s]."""


def with_repeated(scenario, components):
    """Returns the scenario with a sensor whose noise repeats components of the reading."""
    sensor, = scenario.sensing
    quiet = QuietForceSensor(**vars(sensor), loudness=~np.isin(np.arange(6), components))
    fault = RepeatedComponents(0.0, 1.0, components, sensor.noise_multiple * sensor.noise,
                               1.0 / sensor.rate)
    return replace(scenario, sensing=[quiet], faults=[fault])


def read(scenario, freezes, until, force):
    """Returns the statuses of a sensor on a tip at rest, at each reading, and their times."""
    builder, model, sensing = DiagramBuilder(), uv.load_model(scenario), sensing_of(scenario)
    sensor, reading = scenario.sensing[0], reading_of(scenario)
    config = np.append(scenario.start.eta, scenario.start.q)
    chi = model.task_pose(config)[:6]
    still = np.append(config, np.zeros(len(config)))
    script = builder.AddSystem(Script(
        force=lambda time: force if time > sensor.tare + 0.1 else np.zeros(6),
        chi=lambda time: chi, state=lambda time: still))
    wrist = WristSensor.AddToBuilder(
        builder, model, sensor, sensor.imperfection(3), force=script.GetOutputPort("force"),
        chi=script.GetOutputPort("chi"), measured_chi=script.GetOutputPort("chi"))
    measured = FrozenForce(freezes, 9.0).add_to(
        builder, model, wrist.GetOutputPort("force_measured"), uv.Signals(), 0)
    detector = ForceFaultDetector.AddToBuilder(
        builder, model, sensing.period, repeats=sensing.repeats, tare=reading.tare,
        largest=reading.largest, state=script.GetOutputPort("state"), force_measured=measured)
    log = LogVectorOutput(detector.GetOutputPort("force_status"), builder, sensing.period)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(until)
    found = log.FindLog(simulator.get_context())
    return found.sample_times(), found.data()[0]


@pytest.mark.parametrize("share", SHARES)
@pytest.mark.parametrize("name", SETTLED)
def test_a_coarse_sensor_at_rest_is_valid_until_it_freezes(name, share):
    """Then it is found in the declared time."""
    scenario = with_coarse_sensor(uv.load_scenario(name), share)
    shipped, = uv.load_scenario(name).sensing
    for time in (1.0, scenario.duration):
        bound, most = (error_bound(each, time, np.zeros(6)).total
                       for each in (scenario.sensing[0], shipped))
        assert np.all(bound <= most + 1e-12)
    sensing, freezes = sensing_of(scenario), 1.5
    found_after = sensing.repeats * sensing.period
    force = np.array([scenario.task.force[0], 1.0, -2.0, 0.1, 0.2, 0.3])
    times, status = read(scenario, freezes, freezes + found_after + 0.1, force)
    frozen = times > freezes + found_after + 0.5 * sensing.period
    assert np.all(status[times <= freezes] == ForceStatus.VALID)
    assert np.all(status[frozen] == ForceStatus.FROZEN)
    assert 0.0 < found_after <= LONGEST_FREEZE
    assert np.count_nonzero(frozen) > 5


@pytest.mark.parametrize(("least", "found"), [(0.3, True), (0.2, False)])
def test_a_sensor_as_quiet_as_declared_is_valid_until_it_freezes(least, found):
    """One that repeats too often to be told from a frozen one is never taken for it."""
    scenario = uv.load_scenario("girona500_contact")
    sensor, = scenario.sensing
    coarse_steps = np.array([0.2] * 3 + [0.004] * 3)
    quiet = QuietForceSensor(**{**vars(sensor), "resolution": coarse_steps, "least_noise": least},
                             loudness=least)
    scenario = replace(scenario, sensing=[quiet])
    sensing, freezes = sensing_of(scenario), 5.0
    assert (sensing.repeats > 0) == found
    times, status = read(scenario, freezes, freezes + LONGEST_FREEZE + 0.1,
                         np.array([20.0, 1.0, -2.0, 0.1, 0.2, 0.3]))
    assert np.all(status[times <= freezes] == ForceStatus.VALID)
    assert np.any(status == ForceStatus.FROZEN) == found
    if found:  # Not with the declared noise: it repeats more often than that allows.
        loud = sensing_of(replace(scenario, sensing=[replace(quiet, least_noise=1.0)]))
        assert loud.repeats < sensing.repeats


def kinds_of_sensor(scenario):
    """Returns variants of a scenario by name; all errors are within the bounds of the shipped."""
    coarse = {f"{share:g}": with_coarse_sensor(scenario, share) for share in SHARES}
    shipped, = scenario.sensing
    quieter = replace(scenario, sensing=[QuietForceSensor(**vars(shipped), loudness=0.3)])
    return {"shipped": scenario, **coarse, "a third of the noise": quieter,
            "one component": with_repeated(scenario, (1,)),
            "all forces": with_repeated(scenario, (0, 1, 2)),
            "all but one": with_repeated(scenario, (0, 1, 2, 3, 4))}


KINDS = tuple(kinds_of_sensor(uv.load_scenario("girona500_contact")))


@pytest.mark.long
@pytest.mark.parametrize(("name", "kind"), [
    *(("girona500_contact", kind) for kind in KINDS),
    *((name, kind) for name in ("bluerov2_contact", "girona500_stiff")
      for kind in ("shipped", *(f"{share:g}" for share in SHARES), "one component"))])
def test_a_press_is_as_with_the_shipped_sensor_until_the_reading_freezes(name, kind):
    """It touches, settles and holds without a reading lost; then a fault is found in time."""
    freezes = SETTLED[name] + HOLD
    shipped = uv.load_scenario(name, [
        f"duration={freezes + 0.4}", "log_period=0.01", *NEARER.get(name, [])])
    scenario = kinds_of_sensor(shipped)[kind]
    scenario = replace(scenario, faults=[*scenario.faults, FrozenForce(freezes, 9.0)])
    record, sensing = uv.simulate(scenario), sensing_of(scenario)
    before = record.time <= freezes
    # Nothing is lost, and it settles as near as the sensor's bound lets it.
    status, lost = (record.signals[key][:, 0] for key in ("force_status", "force_lost"))
    assert not np.any(status[before])
    assert not np.any(lost[before])
    contact = sensed_contact(scenario)
    force = record.force[:, :3] @ contact.direction
    hold = before & (record.time > SETTLED[name])
    bound = error_bound(shipped.sensing[0], freezes, np.zeros(6)).total[0]
    assert np.max(np.abs(force[hold] - pressing_force(scenario))) < bound
    assert np.all(record.mpc_status == 0.0)
    assert np.max(record.mpc_violation) <= 1e-6
    if "repeated" in record.signals:
        assert record.signals["repeated"][-1, 0] > 0.5 * freezes * shipped.sensing[0].rate
    # The frozen reading.
    found = record.time[np.argmax(status == ForceStatus.FROZEN)]
    assert freezes < found <= freezes + sensing.repeats * sensing.period + scenario.log_period
    late = record.time > found + sensing.patience * sensing.period + scenario.log_period
    assert np.all(lost[late]) and np.any(late)
