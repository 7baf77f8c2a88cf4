"""A surface and a law of one's own with its tube have certificates."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from support.quick import FEW, SETTINGS, search_less

import uvms_drake as uv
from uvms_drake.certificate.certificate import fingerprint, from_data, to_data
from uvms_drake.certificate.certify import basis_of, certify
from uvms_drake.tube.laws import TUBES


@dataclass
class Foam(uv.UnilateralPlane):
    """Force stiffness s + hardening s³ at depth δ, with s of `plane_load`, without damping."""

    hardening: float = 4e5  # N/m³
    deepest: float = 0.05  # m, up to which `force_jacobian` holds

    def load(self, depth):
        s = uv.surfaces.plane_load(depth, self.transition)
        return self.stiffness * s + self.hardening * s**3

    def force(self, chi, chi_dot):
        out = np.zeros_like(chi)
        out[..., :3] = -self.load(self.depth(chi[..., :3]))[..., None] * self.normal
        return out

    def penetration_for(self, force):
        depth = np.linspace(0.0, self.deepest, 50001)
        return float(np.interp(force, self.load(depth), depth))

    def force_jacobian(self):
        slope = self.stiffness + 3.0 * self.hardening * self.deepest**2
        return np.concatenate([-slope * self.normal, np.zeros(3)])[None]


@pytest.mark.slow
def test_it_is_certified_and_the_force_stays_within_the_certified_band(monkeypatch):
    search_less(monkeypatch)
    press = uv.make_scenario("girona500_arm5e", Foam(), force=15.0, posture=[0.0, 1.1, 0.47, 0.0],
                             law=uv.Resolved(k=20.0, sigma=5.0), disturbance=0.01)
    assert press.limits.static_force == 45.0
    press.certificate = replace(press.certificate, **SETTINGS)
    certificate = uv.certify(press)
    assert certificate.certified, str(certificate)
    assert str(certificate).splitlines()[-1].startswith("certified: all ")
    press = certificate.applied_to(press)
    press.duration = 6.0
    record = uv.simulate(press, certified=True)
    held = record.force[record.time > 5.0]
    np.testing.assert_allclose(held[:, 0], 15.0, atol=certificate.bounds["force"] + 0.2)
    assert held[-1, 0] == pytest.approx(Foam().load(record.penetration[-1:])[0])


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
    scenario = uv.load_scenario(str(files / "own.yaml"), FEW)
    assert scenario.ancillary.name == "cascade"
    assert "modules[0]/cascade_law.py" in fingerprint(scenario)["files"]
    law = type(scenario.ancillary)
    assert law in TUBES and type("Derived", (law,), {}) not in TUBES


def test_a_constant_of_ones_own_is_the_supremum_of_its_norm(files, few_searches):
    scenario = uv.load_scenario(str(files / "own.yaml"), FEW)
    model = uv.load_model(scenario)
    basis = basis_of(scenario, model, ("M_max",))
    config, _ = basis.declared.sample(model, 200, np.random.default_rng(1))
    norms = np.linalg.norm(model.mass_matrix(model.kinematics(config)), 2, axis=(-2, -1))
    assert np.max(norms) < basis.value("M_max") < 1.2 * np.max(norms)


@pytest.mark.slow
def test_it_is_certified_with_its_own_constants_and_other_laws_search_theirs_alone(
        files, few_searches):
    own, shipped = (certify(uv.load_scenario(name, FEW)) for name in (
        str(files / "own.yaml"), "girona500_ideal"))
    assert own.certified and shipped.certified
    constants = {name: {each.name for each in certificate.constants}
                 for name, certificate in (("own", own), ("shipped", shipped))}
    assert constants["shipped"] == {"Jx_max", "J_position_max", "J_attitude_max"}
    assert constants["own"] == constants["shipped"] | {"M_max"}
    assert "kg, kg m²" in str(own)
    assert from_data(to_data(own)).tube.e == own.tube.e == shipped.tube.e
