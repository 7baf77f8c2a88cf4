"""A law of one's own with its tube, in one file that a scenario names, has a certificate."""

from pathlib import Path

import numpy as np
import pytest
from support.quick import FEW

from uvms_drake.certificate.certificate import fingerprint, from_data, to_data
from uvms_drake.certificate.certify import basis_of, certify
from uvms_drake.station.problem import load_model
from uvms_drake.station.scenario.scenario import load_scenario
from uvms_drake.tube.laws import TUBES

LAW = """
from dataclasses import dataclass

import uvms_drake as uv


@uv.register
@dataclass
class Cascade(uv.Resolved):
    pass


def product(model, config, zeta, w):
    return (model.mass_matrix(model.kinematics(config)) @ w[..., None])[..., 0]


uv.tubes.register_constant("M_max", uv.tubes.Quantity(product, "kg, kg m²"))


@uv.tubes.register_tube(Cascade, lambda law, weights: (
    "Jx_max", "J_position_max", "J_attitude_max", "M_max"))
def cascade_tube(law, basis):
    return uv.tubes.resolved_law_tube(law, basis)
"""
SCENARIO = """
base: girona500_ideal
modules: [cascade_law.py]
ancillary: !Cascade {k: 20, sigma: 5}
"""


@pytest.fixture(scope="session")  # Slow tests run apart, and a module is imported once.
def files(tmp_path_factory) -> Path:
    """The folder of the law and of the scenario that names it."""
    folder = tmp_path_factory.mktemp("own_tube")
    (folder / "cascade_law.py").write_text(LAW, encoding="utf-8")
    (folder / "own.yaml").write_text(SCENARIO, encoding="utf-8")
    return folder


def test_the_tube_and_its_constants_are_found_by_the_exact_type(files):
    scenario = load_scenario(str(files / "own.yaml"), FEW)
    assert scenario.ancillary.name == "cascade"
    assert "cascade_law.py" in fingerprint(scenario)["files"]
    law = type(scenario.ancillary)
    assert law in TUBES and type("Derived", (law,), {}) not in TUBES


def test_a_constant_of_ones_own_is_the_supremum_of_its_norm(files, few_searches):
    scenario = load_scenario(str(files / "own.yaml"), FEW)
    model = load_model(scenario)
    basis = basis_of(scenario, model, ("M_max",))
    config, _ = basis.declared.sample(model, 200, np.random.default_rng(1))
    norms = np.linalg.norm(model.mass_matrix(model.kinematics(config)), 2, axis=(-2, -1))
    assert np.max(norms) < basis.value("M_max") < 1.2 * np.max(norms)


@pytest.mark.slow
def test_it_is_certified_with_its_own_constants_and_other_laws_search_theirs_alone(
        files, few_searches):
    own, shipped = (certify(load_scenario(name, FEW)) for name in (
        str(files / "own.yaml"), "girona500_ideal"))
    assert own.certified and shipped.certified
    constants = {name: {each.name for each in certificate.constants}
                 for name, certificate in (("own", own), ("shipped", shipped))}
    assert constants["shipped"] == {"Jx_max", "J_position_max", "J_attitude_max"}
    assert constants["own"] == constants["shipped"] | {"M_max"}
    assert "kg, kg m²" in str(own)
    assert from_data(to_data(own)).tube.e == own.tube.e == shipped.tube.e
