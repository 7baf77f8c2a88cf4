"""A law of one's own without a theory: it runs, and it is not certified."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from uvms_drake.certificate.certify import certify
from uvms_drake.control.laws import Resolved
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.model.frames.euler import pose_difference
from uvms_drake.report.figures import deviation_drawing
from uvms_drake.report.summary import format_summary, summarise
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.station.simulation import simulate


@dataclass
class Sloppy(AncillaryLaw):
    """u = ū − g(𝔷 + J_x(𝔮̄)ᵀ𝔢_y), and no more than that."""

    gain: float = 20.0

    def command(self, model, now, nominal_acceleration, nominal_input):
        error = now.zeta[0] - now.zeta[1] + now.J_x[1].T @ pose_difference(*now.y)
        return nominal_input() - self.gain * error


@dataclass
class Derived(Resolved):
    """Another law than the one it is derived from."""


def with_law(name: str, law: AncillaryLaw):
    scenario = load_scenario(name, ["duration=0.4"])
    return replace(scenario, ancillary=law)


@pytest.mark.parametrize("name", ["girona500_ideal"])
@pytest.mark.parametrize("law", [Sloppy(), Derived()])
def test_a_law_without_a_proof_is_not_certified_and_says_so(name, law):
    certificate = certify(with_law(name, law))
    assert not certificate.certified
    assert certificate.tube is None
    kind = type(law).__name__
    assert certificate.verdict.startswith(
        f"not certified: certificate of the law {kind}, none is known; what would help: ")
    assert certificate.verdict in str(certificate)


@pytest.fixture(scope="module")
def record():
    return simulate(with_law("girona500_ideal", Sloppy()))


def test_it_runs_and_its_deviation_is_watched_without_a_bound_along_the_run(record):
    assert np.max(record.deviation_of("task")) > 0.0
    np.testing.assert_array_equal(record.tube_bound, np.inf)
    text = format_summary(summarise(record))
    assert "law sloppy; |y - y_nominal|" in text
    assert "of the bound along the run" not in text
    deviation_drawing(record)
