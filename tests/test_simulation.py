"""Tests of `uvms_drake.simulation`."""

from dataclasses import fields

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import LeafSystem

from uvms_drake.errors import InvalidParameter, RunFailed
from uvms_drake.record import LOG_FILE, save_record
from uvms_drake.scenario import load_scenario
from uvms_drake.simulation import _run, simulate

SHORT = ["duration=1.5", "log_period=0.01"]


class Breaks(LeafSystem):
    """Raises an error at t = 0.25 s."""

    def __init__(self, error):
        super().__init__()
        self._error = error
        self.DeclarePeriodicPublishEvent(1.0, 0.25, self._publish)

    def _publish(self, context):
        raise self._error


@pytest.fixture(scope="module")
def record():
    return simulate(load_scenario("girona500_contact", SHORT))


def test_the_record_has_all_signals_at_all_samples(record):
    np.testing.assert_allclose(record.time, np.arange(151) * 0.01, atol=1e-12)
    for name in ("state", "nominal_state", "chi", "chi_nominal", "nominal_input", "u", "tau",
                 "force", "penetration", "disturbance"):
        assert len(getattr(record, name)) == 151
    assert record.penetration.ndim == 1
    assert record.state.shape[1] == 20
    for field in fields(record):
        if field.name != "scenario":
            assert np.all(np.isfinite(getattr(record, field.name))), field.name


def test_the_run_starts_at_the_scenario_start_at_rest(record):
    start = record.scenario.start
    np.testing.assert_allclose(
        record.state[0], [*start.eta, *start.q, *np.zeros(10)], atol=1e-12)


def test_the_mpc_is_sampled_at_its_period(record):
    np.testing.assert_allclose(record.mpc_time, np.arange(8) * 0.2, atol=1e-12)


def test_the_same_seed_gives_the_same_log_byte_for_byte(record, tmp_path):
    times = []
    again = simulate(record.scenario, progress=times.append)
    for name, item in (("a", record), ("b", again)):
        (tmp_path / name).mkdir()
        save_record(item, tmp_path / name)
    assert (tmp_path / "a" / LOG_FILE).read_bytes() == (tmp_path / "b" / LOG_FILE).read_bytes()
    assert times == sorted(times)
    assert 14 <= len(times) <= 16


def test_a_value_that_cannot_be_used_is_named(record):
    del record
    scenario = load_scenario("girona500_contact", ["disturbance.bound=-0.1"])
    with pytest.raises(InvalidParameter, match=r"disturbance\.bound = -0\.1"):
        simulate(scenario)


def test_an_error_of_drake_ends_the_run_with_its_time():
    with pytest.raises(RunFailed, match=r"stopped at t = 0\.250 s: no way on"):
        _run(Simulator(Breaks(RuntimeError("no\n  way on"))), 1.0)


def test_a_failed_run_keeps_its_own_message():
    with pytest.raises(RunFailed, match=r"^no plan$"):
        _run(Simulator(Breaks(RunFailed("no plan"))), 1.0)
