"""Failures of the runs of a campaign, and the certificate in probability that follows from them.

Every run counts, also one whose wall was touched where it is not of its class, or whose whole
disturbance exceeded its bound: it was drawn from the declared distribution.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from uvms_drake.campaign.campaign import Campaign
from uvms_drake.campaign.draws import declared_distribution
from uvms_drake.certificate.certificate import probability_fingerprint
from uvms_drake.certificate.in_probability import (
    FAILURES,
    ProbabilityCertificate,
    failure_bound,
)
from uvms_drake.station.scenario.scenario import Scenario


def failures_of(result: Mapping[str, Any]) -> tuple[str, ...]:
    """Returns the kinds, of `FAILURES`, in which a run failed.

    Args:
        result: The result of `run.run_one`.
    """
    if result["error"] is not None:
        return ("exception",)
    wall = result.get("wall", {})
    did = {
        "not finite": not result["finite"],
        "tube": bool(result["exits_set"] or result["exits_trajectory"]),
        "limit": result["violations"] > 0,
        "saturation": result["limited"],
        "force": max(wall.get("static", 0.0), wall.get("peak", 0.0)) > 1.0,
        "no plan": result["mpc_failures"] > 0,
        "contact": max(result["losses"], wall.get("losses", 0)) > 0,
        "no touch": bool(wall) and wall["first_touch_s"] is None,
        "mission": not result.get("mission", {"done": True})["done"]}
    return tuple(kind for kind in FAILURES if did.get(kind, False))


def certificate_in_probability(
        campaign: Campaign, scenario: Scenario, results: Sequence[Mapping[str, Any]],
        confidence: float) -> ProbabilityCertificate:
    """Returns the certificate that follows from the runs 0 to N − 1 of a campaign.

    Args:
        campaign: Campaign with the scenario's declared tube.
        scenario: The scenario, as it was loaded.
        results: The result of each of the runs, in any order.
        confidence: Confidence of the bound.
    """
    kinds = {result["index"]: failures_of(result) for result in results}
    assert sorted(kinds) == list(range(len(results))), "a run is missing: it may have failed"
    failed = tuple(index for index in sorted(kinds) if kinds[index])
    inputs = probability_fingerprint(scenario)
    assert inputs["source"] == campaign.source
    return ProbabilityCertificate(
        scenario=scenario.name, runs=len(results), failures=len(failed), confidence=confidence,
        probability=failure_bound(len(results), len(failed), confidence),
        kinds={kind: sum(kind in each for each in kinds.values()) for kind in FAILURES},
        failed=failed, distribution=tuple(declared_distribution(campaign.base)),
        seed=campaign.seed, campaign=campaign.identity,
        mission=", ".join(type(step).__name__.lower() for step in scenario.mission.steps),
        **inputs)
