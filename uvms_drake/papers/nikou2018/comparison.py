"""The paper's radii for the gains and the disturbance of a scenario, beside its certificate."""

from dataclasses import replace

import numpy as np

from uvms_drake.certificate.certificate import Certificate
from uvms_drake.certificate.certify import basis_of
from uvms_drake.common.errors import require
from uvms_drake.control.laws.law import AncillaryLaw
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.papers.nikou2018.comparison_system import smallest_k, transpose_tube
from uvms_drake.papers.nikou2018.constants import TRANSPOSE, lemma_constants
from uvms_drake.papers.nikou2018.kinematics.tube import KINEMATIC, kinematic_tubes
from uvms_drake.papers.nikou2018.lemma import paper_conditions
from uvms_drake.station.motions.motion import Motion
from uvms_drake.station.motions.motions import motion_of
from uvms_drake.station.scenario.scenario import Scenario
from uvms_drake.tube.law_tube import Basis


def check_comparison(motion: Motion, law: AncillaryLaw) -> None:
    """Raises `InvalidParameter` if a law has no gains of the paper."""
    require(not motion.has_forces or bool(np.isfinite(law.k)), "ancillary",
            type(law).__name__, "a law with one k and one σ, for --paper")


def with_paper(certificate: Certificate, scenario: Scenario, model: ContactModel) -> Certificate:
    """Returns the certificate with the paper's radii and the constants that these need.

    Args:
        certificate: That of the scenario.
        scenario: Gains, disturbance and limits.
        model: The controller's model.
    """
    names, radii = ((TRANSPOSE, paper_radii) if motion_of(scenario).has_forces
                    else (KINEMATIC, paper_kinematic_radii))
    basis = basis_of(scenario, model, names)
    constants = {each.name: each for each in certificate.constants} | basis.constants
    return replace(certificate, constants=tuple(constants.values()),
                   paper=radii(scenario.ancillary, basis))


def paper_radii(law: AncillaryLaw, basis: Basis) -> dict[str, float]:
    """Returns the radii of the paper's Lemma for the same constants, gains and d̃, to compare.

    They depend on the constants `TRANSPOSE`. Empty for a law whose rows have gains of their own.
    """
    if np.isnan(law.k):
        return {}
    lemma = lemma_constants(basis.constants)
    tubes = paper_conditions(lemma, law.k, law.sigma, basis.d_bound)
    least = smallest_k(lemma)
    return {"printed radius": tubes.printed.e, "corrected radius": tubes.corrected.e,
            "comparison system radius":
                transpose_tube(lemma, law.k, law.sigma, basis.d_bound).e,
            "smallest k": least.k, "at σ": least.sigma}


def paper_kinematic_radii(law: AncillaryLaw, basis: Basis) -> dict[str, float]:
    """Returns the radii of both laws with the same σ and w̃, and the least σ of the paper's law.

    They depend on the constants `KINEMATIC`.
    """
    J_min, L_c = basis.value("J_min"), basis.value("L_c_chi")
    found = kinematic_tubes(J_min, L_c, law.sigma, basis.d_bound)
    return {"printed radius": found.printed, "corrected radius": found.corrected,
            "radius of resolved": found.resolved,
            "smallest σ": L_c / J_min if J_min > 0.0 else np.inf}
