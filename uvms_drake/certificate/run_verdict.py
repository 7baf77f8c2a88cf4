"""The verdict of a run: one exit status and one sentence, first in everything that tells of it."""

from collections.abc import Mapping, Sequence
from typing import Any

BROKEN, FAILED = 3, 4
"""Exit status of a completed run that passed a limit, left its tube, pressed a wall that is not of
its declared class, had a motor or a limit that cut, or no plan, under a certificate, or retreated;
and of a run that an exception ended."""
BANDS = {"motion": "at touch and in motion", "hold": "in a hold"}
"""Names of the bands of the force of a sensed contact."""
NAMED = ("tube", "limit", "contact")
"""Kinds of `in_probability.FAILURES` that `broken` names."""
VIOLATIONS = ("tube_left", "limit_violated")
"""Kinds of `events` that are named where an exception has ended a run."""


def verdict_of(summary: dict[str, Any], also: Sequence[str] = ()) -> dict[str, Any]:
    """Returns `status`, the exit status of a run, and `text`, the sentence that says why.

    A certificate changes the words, not the status.

    Args:
        summary: Of the run, of `summarise`.
        also: Further ways in which it failed, with a certificate in probability.
    """
    failed = ", ".join([*broken(summary), *also])
    certified, claim = summary["tube"]["certified"], summary["in_probability"]
    departed = ", ".join(summary["contact"].get("out_of_class", {}))
    if summary["failure"]:
        begins = [event["time_s"] for event in summary["events"] if event["kind"] in VIOLATIONS]
        since = f", from {min(begins):.2f} s on" if begins else ""
        return {"status": FAILED, "text": f"FAILED {summary['failure']}" + (
            f"; before that LIMITS VIOLATED: {failed}{since}" if failed else "")}
    if retreat := summary.get("safety", {}).get("text"):
        return {"status": BROKEN, "text": retreat + (
            f"; LIMITS VIOLATED: {failed}" if failed else "")}
    if claim is not None:
        own = (f"this run FAILED: {failed}" if failed else
               "this run did not fail: tube and all limits kept")
        return {"status": BROKEN if failed or claim["outside"] else 0,
                "text": f"{own}; {'; '.join(claim['outside']) or claim['verdict']}"}
    # Assumptions of the certificate that the run did not keep, then its guarantees.
    parts = []
    if departed:
        parts.append("NO GUARANTEE for this wall: " + (
            "the certificate is for walls of the class that `contact` declares, and it was not of "
            f"it ({departed})" if certified else
            f"it was not of the class that `contact` declares ({departed})"))
    if certified and any(event["kind"] == "motor_limited" for event in summary["events"]):
        parts.append("NO GUARANTEE: a motor cut the torque of a joint, which the certificate "
                     "assumes not to be asked for")
    if failed:
        kept = certified and not parts
        parts.append(f"{'GUARANTEES BROKEN' if kept else 'LIMITS VIOLATED'}: {failed}")
    text = "; ".join(parts) or f"all {'guarantees' if certified else 'limits'} kept"
    return {"status": BROKEN if parts else 0,
            "text": text if certified else f"{text} (without a certificate)" if parts else
            f"{text}, without a certificate"}


def broken(summary: dict[str, Any]) -> list[str]:
    """Returns the limits that a run has violated, its tube if it left it, and its force bands.

    The tube is left in any row. With a certificate it is the certified one, also along the run; a
    command that was cut and a sample without a plan count then, with one in probability a lost
    contact.
    """
    names, tube = violated_limits(summary), summary["tube"]
    names += [f"the force band {BANDS[name]}" for name, row in
              summary["contact"].get("force_bands", {}).items() if row and row["exits"]]
    counted = summary["in_probability"] is not None
    names += ["the contact, lost"] * bool(counted and summary["contact"]["losses"])
    if tube["certified"]:
        trip = summary.get("safety", {}).get("retreated_s")
        names += ["the command, cut"] * any(event["kind"] == "input_limited" and (
            trip is None or event["time_s"] < trip) for event in summary["events"])
        names += ["the MPC, without a plan"] * bool(summary["mpc"]["own_failures"])
    if tube["certified"] or counted:
        return [*names, *(f"the tube, {row}" for row in tube["left"]), *(
            f"the tube, {what}" for key, what in (
                ("exits", "set-wise"), ("exits_along_the_run", "along the run")) if tube[key])]
    rows = f" ({', '.join(tube['left'])})" if tube["left"] else ""
    return names + [f"the declared tube{rows}"] * bool(
        tube["left"] or (tube["exits"] and tube["bound_e"] > 0.0))


def violated_limits(summary: dict[str, Any]) -> list[str]:
    """Returns the limits that a run has violated."""
    return [name for name, row in summary["constraints"].items() if is_violated(row)]


def is_violated(row: Mapping[str, Any]) -> bool:
    """Returns whether a row of a limit is violated; one that is not a number, None in JSON, is."""
    return row["margin"] is None or not row["margin"] >= 0.0
