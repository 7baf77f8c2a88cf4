"""A flat surface of one's own has a certificate: a `UnilateralPlane` with another force."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from support.quick import SETTINGS, search_less

import uvms_drake as uv


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
