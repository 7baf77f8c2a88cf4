"""Failures of the runs of a campaign, and the certificate in probability that follows from them.

Every run counts, also one whose wall was touched where it is not of its class, or whose whole
disturbance exceeded its bound: it was drawn from the declared distribution.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from uvms_drake.campaign.campaign import Campaign
from uvms_drake.campaign.draws import declared_distribution, never_drawn
from uvms_drake.certificate.attempts import Attempt
from uvms_drake.certificate.certificate import probability_fingerprint
from uvms_drake.certificate.in_probability import (
    FAILURES,
    ProbabilityCertificate,
    failure_bound,
    spent,
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
        "tube": bool(result["exits_set"] or result["exits_trajectory"]
                     or max(result["use"].values(), default=0.0) > 1.0),
        "limit": result["violations"] > 0,
        "saturation": result["limited"],
        "force": max(wall.get("static", 0.0), wall.get("peak", 0.0)) > 1.0,
        "no plan": result["mpc_failures"] > 0,
        "contact": max(result["losses"], wall.get("losses", 0)) > 0,
        "no touch": not result["touched"],
        "force line": (result["off_line"] or 0.0) > 1.0,
        "mission": not result.get("mission", {"done": True})["done"],
        "retreat": result.get("retreated_s") is not None}
    return tuple(kind for kind in FAILURES if did.get(kind, False))


def certificate_in_probability(
        campaign: Campaign, attempts: tuple[Attempt, ...], scenario: Scenario,
        results: Sequence[Mapping[str, Any]], confidence: float) -> ProbabilityCertificate:
    """Returns the certificate that follows from the runs 0 to N − 1 of a campaign.

    Args:
        campaign: Campaign with the scenario's declared tube.
        attempts: The attempts at its task, this one last.
        scenario: The scenario, as it was loaded.
        results: The result of each of the runs, in any order.
        confidence: Confidence of the bound.
    """
    kinds = {result["index"]: failures_of(result) for result in results}
    assert sorted(kinds) == list(range(len(results))), "a run is missing: it may have failed"
    failed = tuple(index for index in sorted(kinds) if kinds[index])
    inputs = probability_fingerprint(scenario)
    assert inputs["source"] == campaign.source and attempts[-1].seed == campaign.seed
    ended = [result for result in results if result["error"] is None]
    uses = [result["use"] for result in ended if result["use"]]
    pressed = [step for step in scenario.mission.steps if step.force > 0.0]
    forces = [force for step in pressed for force in (step.force, step.strongest)] or [
        result["desired_force"] for result in ended if result["off_line"] is not None]
    return ProbabilityCertificate(
        scenario=scenario.name, runs=len(results), failures=len(failed), confidence=confidence,
        probability=failure_bound(len(results), len(failed), spent(confidence, len(attempts))),
        kinds={kind: sum(kind in each for each in kinds.values()) for kind in FAILURES},
        failed=failed, distribution=tuple(declared_distribution(campaign.base)),
        never_drawn=tuple(never_drawn(campaign.base)),
        draws={key: sum(result.get(key, 0) for result in results) for key in ("starts", "walls")},
        use={row: max(use[row] for use in uses) for row in (uses[0] if uses else ())},
        supervisor={cause: max(result["supervisor"][cause] for result in ended)
                    for cause in (ended[0]["supervisor"] if ended else ())},
        force={"least": min(forces, default=None), "largest": max(forces, default=None),
               "off_line": max((result["off_line"] for result in ended
                                if result["off_line"] is not None), default=None)},
        attempts=attempts, campaign=campaign.identity,
        mission=", ".join(type(step).__name__.lower() for step in scenario.mission.steps),
        **inputs)
