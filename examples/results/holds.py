"""Certified force bands of the scenarios with an unknown wall, in motion and in a hold.

`python examples/results/holds.py > examples/results/holds.md` computes the tube of each scenario,
half a minute to some minutes each, without terminal set and second search.
"""

import argparse

import numpy as np
from make_all import provenance

import uvms_drake as uv
from uvms_drake.certificate.certify import basis_of
from uvms_drake.control.limits.radii import HoldRadii
from uvms_drake.station.contact.bounds import pressing_force, sensed_contact
from uvms_drake.station.contact.tube_in_contact import in_contact
from uvms_drake.station.problem import check_inputs
from uvms_drake.tube.laws import TUBES
from uvms_drake.tube.ultimate_bounds import HOLD, LIKELY, ultimate_bounds

SCENARIOS = ("girona500_contact", "jacket_inspection", "bluerov2_contact", "girona500_stiff",
             "girona500_tip_first", "girona500_inspection", "bluerov2_cp_probe",
             "girona500_unknown_floor")


def bands_of(scenario: uv.Scenario) -> tuple[HoldRadii, dict[str, float]]:
    """Returns the radii in a hold and the force bounds of a scenario."""
    model = check_inputs(scenario)
    basis = basis_of(scenario, model)
    found = in_contact(
        TUBES[type(scenario.ancillary)].tube(scenario.ancillary, basis), scenario, basis)
    failed = [str(each) for each in found.conditions if not each.holds]
    if failed or found.radii.hold is None:
        raise SystemExit(f"{scenario.name}: {failed}")
    wrench = sensed_contact(scenario).wrench(pressing_force(scenario))
    return found.radii.hold, ultimate_bounds(found.radii, model.surface, np.zeros(6), wrench)


def row_of(name: str) -> str:
    """Returns the row of a scenario."""
    scenario = uv.load_scenario(name)
    hold, bounds = bands_of(scenario)
    slow = sensed_contact(scenario).hold
    declared = "–" if slow is None else f"{slow.force_rate:g}, {slow.force_ripple:g}"
    return (f"| `{name}` | {pressing_force(scenario):g} | {bounds['force']:.3g} | "
            f"{bounds[HOLD]:.3g} | {hold.time:.2g} | {bounds[LIKELY]:.3g} | {declared} |")


def main() -> None:
    """Prints the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenarios", nargs="*", default=SCENARIOS)
    names = parser.parse_args().scenarios
    print("# Force bands in motion and in a hold\n\n"
          f"{provenance()} Command: `python examples/results/holds.py`.\n\n"
          "Bands are for a plan at its target: in motion at any speed within the limits, the only "
          "one that there was\nbefore, and in a hold from so long after the plan stands. *Likely* "
          "takes the noise of the tare for independent,\nand is not certified. Friction is the "
          "declared rate and ripple of a hold, those of any motion where there is none.\n\n"
          "| scenario | F [N] | in motion [N] | in a hold [N] | from [s] | likely [N] "
          "| friction [N/s, N] |\n|---|---|---|---|---|---|---|")
    for name in names:
        print(row_of(name), flush=True)


if __name__ == "__main__":
    main()
