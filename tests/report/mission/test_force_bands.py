"""Tests of the check of a run against the certified bands of the force."""

from dataclasses import replace

import numpy as np
import pytest
from support.synthetic import synthetic_sensed_record

from uvms_drake.control.limits.radii import HoldRadii
from uvms_drake.report.headline import broken
from uvms_drake.report.mission.force_bands import (
    force_bands,
    format_bands,
    has_stood,
    summarise_bands,
)
from uvms_drake.report.summary import summarise
from uvms_drake.tube.ultimate_bounds import hold_band, tip_errors

HOLD = HoldRadii(time=0.5, depth=3e-4, position=4e-4, advance=0.01, standing=0.0025, reading=1.5,
                 age=0.03)
STANDS = 2.0  # s, from when on the plan does


@pytest.fixture(scope="module")
def record():
    """A plan that stands from 2 s on, in contact from 1 s on, 1 mm short by 800 N/m."""
    base = synthetic_sensed_record(4.0)
    time, nominal = base.time, base.nominal_state.copy()
    nominal[:, 10:] = np.where(time[:, None] < STANDS, 0.05, 0.0)
    nominal[:, 10] += np.where(np.isclose(time, 3.0), 0.05, 0.0)  # It moves once more.
    force = np.zeros((len(time), 6))
    force[:, 0] = 20.0 + np.where(time < STANDS, 6.0, 0.4)
    target = base.chi_nominal[:, :3] + [0.001, 0.0, 0.0]
    return replace(
        base, nominal_state=nominal, force=force, certified=np.array(True),
        scenario=replace(base.scenario, tube=replace(base.scenario.tube, hold=HOLD)),
        signals=base.signals | {"target": target, "touched": (time >= 1.0)[:, None].astype(float),
                                  "stiffness_used": np.full((len(time), 1), 800.0)})


def test_a_plan_has_stood_once_all_of_its_speeds_were_small_for_the_time(record):
    stood, time = has_stood(record), record.time
    expected = ((time > STANDS + 0.49) & (time < 2.99)) | (time > 3.49)
    assert np.count_nonzero(stood != expected) <= 2
    without = replace(record, scenario=replace(
        record.scenario, tube=replace(record.scenario.tube, hold=None)))
    assert not np.any(has_stood(without))


def test_each_instant_in_contact_has_its_band(record):
    found, contact = force_bands(record), record.scenario.contact
    assert np.all(np.isnan(found.bound[record.time < 0.99]))
    assert found.bound[found.holds] == pytest.approx(hold_band(contact, 20.0, HOLD, 0.0008))
    moving = (record.time >= 1.0) & ~found.holds
    assert found.bound[moving] == pytest.approx(
        contact.band(20.0, tip_errors(record.scenario.tube), 0.0, 0.0008))
    assert found.error[found.holds] == pytest.approx(0.4)


def test_the_summary_has_both_phases_and_a_band_that_is_left_breaks_the_guarantee(record):
    bands = summarise_bands(record)["force_bands"]
    least = hold_band(record.scenario.contact, 20.0, HOLD, 0.0008)
    assert bands["hold"]["worst_ratio"] == pytest.approx(0.4 / least)
    assert bands["motion"]["worst_error"] == pytest.approx(6.0)
    assert bands["hold"]["exits"] == bands["motion"]["exits"] == 0
    assert "in a hold" in format_bands(bands)[1] and f"{least:.3g} N" in format_bands(bands)[1]
    outside = record.force.copy()
    outside[-1, 0] = 20.0 + 1.01 * least
    left = summarise(replace(record, force=outside))
    assert left["contact"]["force_bands"]["hold"]["exits"] == 1
    assert "the force band in a hold" in broken(left)


def test_a_run_without_a_certificate_has_no_bands(record):
    assert summarise_bands(replace(record, certified=np.array(False))) == {}
    assert format_bands({}) == []
