"""A law of one's own without a theory: it runs, and it is not certified."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import uvms_drake as uv
from uvms_drake.report.figures import deviation_drawing
from uvms_drake.report.summary import format_summary


@dataclass
class Sloppy(uv.AncillaryLaw):
    """u = ū − g(𝔷 + J_x(𝔮̄)ᵀ𝔢_y), and no more than that."""

    gain: float = 20.0

    def command(self, model, now, nominal_acceleration, nominal_input):
        error = now.zeta[0] - now.zeta[1] + now.J_x[1].T @ uv.pose_difference(*now.y)
        return nominal_input() - self.gain * error


@dataclass
class Derived(uv.Resolved):
    """Another law than the one it is derived from."""


def with_law(name: str, law: uv.AncillaryLaw):
    scenario = uv.load_scenario(name, ["duration=0.4"])
    return replace(scenario, ancillary=law)


@pytest.mark.parametrize("name", ["girona500_ideal"])
@pytest.mark.parametrize("law", [Sloppy(), Derived()])
def test_a_law_without_a_proof_is_not_certified_and_says_so(name, law):
    certificate = uv.certify(with_law(name, law))
    assert not certificate.certified
    assert certificate.tube is None
    kind = type(law).__name__
    assert certificate.verdict.startswith(
        f"not certified: certificate of the law {kind}, none is known; what would help: ")
    assert certificate.verdict in str(certificate)


@pytest.fixture(scope="module")
def record():
    return uv.simulate(with_law("girona500_ideal", Sloppy()))


def test_it_runs_and_its_deviation_is_watched_without_a_bound_along_the_run(record):
    assert np.max(record.deviation_of("task")) > 0.0
    np.testing.assert_array_equal(record.tube_bound, np.inf)
    text = format_summary(uv.summarise(record), full=True)
    assert "law sloppy; |y - y_nominal|" in text
    assert "of the bound along the run" not in text
    deviation_drawing(record)
