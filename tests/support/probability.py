"""A certificate in probability for tests."""

from uvms_drake.certificate.attempts import Attempt
from uvms_drake.certificate.certificate import probability_fingerprint
from uvms_drake.certificate.in_probability import FAILURES, ProbabilityCertificate
from uvms_drake.station.scenario.scenario import load_scenario

NAME = "girona500_real_loop"


def made(failed=(), runs=60, p=0.0487, **changes) -> ProbabilityCertificate:
    """Returns a certificate with the given failed runs, probability and other changes."""
    scenario = load_scenario(NAME)
    kinds = dict.fromkeys(FAILURES, 0) | ({"tube": len(failed)} if failed else {})
    return ProbabilityCertificate(**({
        "scenario": NAME, "runs": runs, "failures": len(failed), "confidence": 0.95,
        "probability": p, "kinds": kinds, "failed": tuple(failed),
        "distribution": ("start: anywhere", "wall: any"), "never_drawn": (),
        "draws": {"starts": 2 * runs, "walls": runs}, "use": {"depth": 0.5, "u_heave": 0.75},
        "supervisor": {}, "force": {"least": 5.0, "largest": 20.0, "off_line": 0.4},
        "attempts": (Attempt("girona500_arm5e, SensedContact, press", NAME, runs, 64 * "a", 0.95),),
        "campaign": "c0ffee", **probability_fingerprint(scenario)} | changes))
