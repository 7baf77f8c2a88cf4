"""Tests of `uvms_drake.model.description.hydrodynamics_file`."""

from pathlib import Path

import numpy as np
import pytest

from uvms_drake.common.errors import InvalidParameter
from uvms_drake.common.schema import check_values
from uvms_drake.model.description.hydrodynamics_file import (
    AddedMass,
    BodyHydrodynamics,
    Drag,
    HydrodynamicParameters,
    added_mass_about_origin,
    load_hydrodynamics,
)


def _asymmetric() -> np.ndarray:
    M = np.eye(6)
    M[0, 4] = 0.5
    return M


@pytest.mark.parametrize(
    ("body", "key", "allowed"),
    [
        (BodyHydrodynamics(displaced_volume=-1e-3), "displaced_volume", "zero or positive"),
        (BodyHydrodynamics(displaced_volume=np.nan), "displaced_volume", "zero or positive"),
        (BodyHydrodynamics(center_of_buoyancy=np.zeros(2)), "center_of_buoyancy",
         "3 finite numbers"),
        (BodyHydrodynamics(added_mass=[AddedMass(), AddedMass(matrix=_asymmetric())]),
         r"added_mass\[1\].matrix", "row 1, column 5: 0.5 against 0 in row 5"),
        (BodyHydrodynamics(added_mass=[AddedMass(matrix=np.array([1, 1, 1, 1, 1, -1.0]))]),
         r"added_mass\[0\].matrix", "its smallest eigenvalue is -1"),
        (BodyHydrodynamics(added_mass=[AddedMass(matrix=np.ones(5))]),
         r"added_mass\[0\].matrix", "6×6 matrix"),
        (BodyHydrodynamics(added_mass=[AddedMass(matrix=np.eye(5))]),
         r"added_mass\[0\].matrix", "6×6 matrix"),
        (BodyHydrodynamics(added_mass=[AddedMass(point=np.zeros(6))]),
         r"added_mass\[0\].point", "3 finite numbers"),
        (BodyHydrodynamics(drag=[Drag(linear=np.array([0, 0, 0, 0, 0, -1.0]))]),
         r"drag\[0\].linear", "zero or positive"),
        (BodyHydrodynamics(drag=[Drag(), Drag(quadratic=-np.ones(6))]),
         r"drag\[1\].quadratic", "zero or positive"),
        (BodyHydrodynamics(drag=[Drag(linear=np.zeros(3))]), r"drag\[0\].linear",
         "6 finite numbers"),
        (BodyHydrodynamics(drag=[Drag(point=np.array([np.inf, 0, 0]))]), r"drag\[0\].point",
         "3 finite numbers"),
    ])
def test_a_value_without_physical_meaning_is_refused_by_its_key(body, key, allowed):
    parameters = HydrodynamicParameters(bodies={"hull": body})
    with pytest.raises(InvalidParameter, match=rf"^bodies\.hull\.{key} = .*{allowed}"):
        check_values(parameters)


@pytest.mark.parametrize("density", [0.0, -1000.0, np.inf, np.nan])
def test_the_fluid_density_must_be_positive(density):
    with pytest.raises(InvalidParameter, match=r"^fluid_density = .*must be positive"):
        check_values(HydrodynamicParameters(fluid_density=density))


def test_a_semidefinite_added_mass_is_accepted():
    """A slender cylinder has no added inertia about its axis."""
    body = BodyHydrodynamics(added_mass=[AddedMass(matrix=np.array([0, 1, 1, 0, 1, 1.0]))])
    check_values(HydrodynamicParameters(bodies={"rod": body}))


def test_added_mass_about_the_origin_has_the_energy_of_the_motion_of_its_point():
    """½ V_Boᵀ M V_Bo = ½ Σ V_Pᵀ M_P V_P with v_P = v + ω × p, for items that add up."""
    rng = np.random.default_rng(seed=6)
    roots = rng.normal(size=(3, 6, 6))
    items = [AddedMass(matrix=L @ L.T, point=rng.normal(size=3)) for L in roots]
    M = added_mass_about_origin(items)
    np.testing.assert_allclose(M, M.T, atol=1e-12)
    for V in rng.normal(size=(20, 6)):
        energy = 0.0
        for item in items:
            V_P = np.concatenate([V[:3] + np.cross(V[3:], item.point), V[3:]])
            energy += 0.5 * V_P @ item.matrix @ V_P
        np.testing.assert_allclose(0.5 * V @ M @ V, energy, rtol=1e-12)


def _write(folder: Path, text: str) -> Path:
    path = folder / "hydrodynamics.yaml"
    path.write_text(text)
    return path


def test_a_file_is_read_with_defaults_for_what_it_leaves_out(tmp_path):
    parameters = load_hydrodynamics(_write(tmp_path, """
        fluid_density: 1025.0
        bodies:
          hull:
            displaced_volume: 0.25
            added_mass:
              - matrix: [1, 2, 3, 4, 5, 6]
            drag:
              - quadratic: [1, 2, 3, 4, 5, 6]
                point: [0.1, 0.2, 0.3]
        """))
    hull = parameters.bodies["hull"]
    assert parameters.fluid_density == 1025.0
    assert hull.displaced_volume == 0.25
    np.testing.assert_array_equal(hull.center_of_buoyancy, np.zeros(3))
    np.testing.assert_array_equal(hull.added_mass[0].matrix, [1, 2, 3, 4, 5, 6])
    np.testing.assert_array_equal(hull.added_mass[0].point, np.zeros(3))
    np.testing.assert_array_equal(hull.drag[0].linear, np.zeros(6))
    np.testing.assert_array_equal(hull.drag[0].quadratic, [1, 2, 3, 4, 5, 6])
    np.testing.assert_array_equal(hull.drag[0].point, [0.1, 0.2, 0.3])
