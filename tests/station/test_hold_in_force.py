"""When a hold is in force: with a noise that never rests, and with a plan that is kept short."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator
from support.unknown_wall import close_to_the_wall

import uvms_drake as uv
from uvms_drake.control.limits.radii import HoldRadii
from uvms_drake.report.contact_check import force_bands, has_stood, summarise_bands
from uvms_drake.sensing.force_sensor import ForceSensor
from uvms_drake.sensing.wrist_sensor import Imperfection
from uvms_drake.station.contact.bounds import mean_time, sensed_contact
from uvms_drake.station.problem import load_model
from uvms_drake.station.simulation import make_record
from uvms_drake.tube.ultimate_bounds import hold_band

pytestmark = pytest.mark.slow
MEAN = 0.8
HOLD = HoldRadii(time=1.3 + MEAN, depth=4.8e-4, position=6.8e-4, advance=0.0175, standing=0.002,
                 reading=2.23, age=0.03, since=0.5 * MEAN)
"""Radii about those of the certificate."""


@dataclass
class SquareWaveSensor(ForceSensor):
    """A force sensor whose noise is at its bound along all axes, with a sign of a period."""

    wave: float = 0.4
    """Period [s]."""

    def imperfection(self, seed: int) -> Imperfection:
        """Returns the errors, with drawn noise until after the tare."""
        drawn = super().imperfection(seed)
        most = self.noise_multiple * np.asarray(self.noise)

        def noise(index: int) -> np.ndarray:
            if index < 0.6 * self.rate:
                return drawn.noise(index)
            later = (index + 0.5) / self.rate % self.wave < 0.5 * self.wave
            return np.append(most[:3] if later else -most[:3], drawn.noise(index)[3:])

        return drawn._replace(noise=noise)


def run_of(duration, deepest=np.inf, **noise):
    """Returns the record of a press near the wall, with the certified tube in a hold."""
    scenario = close_to_the_wall("surface.geometry.point.0=0.01", "contact.clearance=0.02",
                                 f"duration={duration}")
    shipped, = scenario.sensing
    sensing = [SquareWaveSensor(**vars(shipped), **noise)] if noise else [shipped]
    scenario = replace(scenario, sensing=sensing, tube=replace(scenario.tube, hold=HOLD))
    model = load_model(scenario)
    scenario = uv.with_step(scenario, model)
    station = uv.make_station(scenario, certified=True, model=model)
    simulator = Simulator(station)
    ApplySimulatorConfig(scenario.simulator, simulator)
    context = simulator.get_mutable_context()
    station.GetInputPort("deepest").FixValue(context, [deepest])
    simulator.AdvanceTo(duration)
    return make_record(scenario, model, uv.read_logs(station, context), 1.0, certified=True)


@pytest.mark.long
@pytest.mark.parametrize(("wave", "share"), [(0.4, 0.4), (2.0 * MEAN, 0.2)])
def test_noise_within_its_bound_cannot_keep_the_plan_in_motion(wave, share):
    """A square wave of the period to which the MPC answers most, and to which the mean does."""
    bands = summarise_bands(run_of(10.0, wave=wave))["force_bands"]
    assert bands["hold"]["share"] > share
    assert bands["hold"]["exits"] == 0


@pytest.mark.long
def test_a_plan_that_deepest_keeps_short_of_its_target_is_in_no_hold():
    record = run_of(8.0, deepest=0.022)
    contact = sensed_contact(record.scenario)
    assert mean_time(record.scenario) == pytest.approx(MEAN, rel=0.02)
    stiff = replace(record.scenario, contact=replace(contact, stiffness=20000.0))
    assert mean_time(stiff) == pytest.approx(0.05 * MEAN, rel=0.1)
    found, stood = force_bands(record), has_stood(record) & (record.signals["touched"][:, 0] > 0.0)
    assert np.mean(stood) > 0.2
    off = np.max(np.abs(found.error[stood]))
    assert off > hold_band(contact, 20.0, HOLD), "as an error in a hold it would be outside"
    assert not np.any(found.holds)
    assert summarise_bands(record)["force_bands"]["hold"] is None
    assert np.all(np.abs(found.error[stood]) < found.bound[stood])
