"""Tests of the scenario's own surface beside its declared class, before anything is computed."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import uvms_drake as uv
from uvms_drake.certificate.certify import STAGES, certify
from uvms_drake.command.main import main
from uvms_drake.model.surface import Cylinder, UnilateralPlane
from uvms_drake.station.contact.drawn_mission import ends_of
from uvms_drake.station.contact.drawn_surfaces import draw_wall
from uvms_drake.station.problem import load_model, true_surface
from uvms_drake.station.scenario.scenario_file import shipped_scenarios
from uvms_drake.station.true_wall import NOT_FOUND, in_words, outside, path_of, surface_depth

SENSED = [name for name in shipped_scenarios() if not uv.load_scenario(name).simulation
          and uv.load_scenario(name).contact.declared_wall() is not None]
MAIN = "girona500_contact"


@dataclass
class Harder(UnilateralPlane):
    """A plane of one's own: the force grows with the depth cubed, too."""

    def force(self, chi, chi_dot):
        depth = self.depth(chi[..., :3])
        return super().force(chi, chi_dot) * (1.0 + 900.0 * depth * depth)[..., None]


def compared(*overrides, scenario=MAIN, **changes):
    found = replace(uv.load_scenario(scenario, overrides), **changes)
    return outside(found, load_model(found))


def ends(scenario, contact):
    start = load_model(scenario).task_pose(scenario.start.config)[:3]
    return ends_of(scenario.mission, contact.walls, start,
                   np.asarray(scenario.task.pose, dtype=float)[:3])


@pytest.mark.parametrize("name", SENSED)
def test_the_surface_of_a_shipped_scenario_is_of_its_declared_class(name):
    """By its law along the path of the tip, and proven in balls about each place of that path."""
    scenario = uv.load_scenario(name)
    model, contact = load_model(scenario), scenario.contact.declared_wall()
    assert outside(scenario, model) == {}
    surface, n = true_surface(scenario), contact.direction
    start = model.task_pose(scenario.start.config)[:6]
    path = path_of(scenario, contact.walls, start[:3])
    chi = np.concatenate([path, np.tile(start[3:], (len(path), 1))], axis=1)
    touches = path + (surface_depth(surface, chi, n) - path @ n)[:, None] * n
    deepest = surface.law.depth_for(contact.force) / np.cos(contact.angle)
    depths = np.arange(0.5, 1.0 + deepest / 0.005) * 0.005
    for center in (touches[::2, None] + depths[:, None] * n).reshape(-1, 3):
        found = surface.membership(n, center, 0.009)  # 8 mm beside the path, and all depths.
        for key in ("stiffness", "angle", "dissipation", "friction"):
            assert getattr(found, key) <= getattr(contact, key), key


@pytest.mark.parametrize(("override", "key", "observed"), [
    ("surface.law.stiffness=1500", "stiffness", 1500 * np.cos(np.deg2rad(3.0))),
    ("surface.law=!Bilinear {stiffness: 700, ratio: 2.0, knee: 0.01}", "stiffness", 1398.0),
    ("surface.geometry.normal=[-0.98, 0, 0.19899748742]", "angle", np.arccos(0.98)),
    ("surface.dissipation=1.2", "dissipation", 1.196), ("surface.friction=0.7", "friction", 0.7),
    ("surface_error={stiffness: 2.0}", "stiffness", 1398.0),
    ("contact.force_error=2.0", "force_error", 2.8)])
def test_a_bound_that_is_exceeded_is_found_with_its_value(override, key, observed):
    ((found, departure),) = compared(override).items()
    assert found == key
    assert departure.observed == pytest.approx(observed, rel=0.01)
    assert f"contact.{key} declares {departure.specified:.4g}, it is " in in_words({key: departure})


def test_a_wall_that_is_too_near_is_found_by_the_distance_along_the_direction():
    scenario = uv.load_scenario(MAIN, ["surface.geometry.normal=[-1, 0, 0]"])
    tip = load_model(scenario).task_pose(scenario.start.config)[0]
    near = compared("surface.geometry.normal=[-1, 0, 0]", f"surface.geometry.point.0={tip + 0.05}")
    assert list(near) == ["clearance"]
    assert near["clearance"].observed == pytest.approx(0.05, abs=1e-6)


def test_a_wall_farther_than_half_a_metre_is_compared_too():
    far = compared("surface.geometry.point.0=0.4", "surface.law.stiffness=20000",
                   "surface.friction=0.9")
    assert set(far) == {"stiffness", "friction"}
    assert compared("surface.geometry.point.0=0.4") == {}


@dataclass
class Bounded(UnilateralPlane):
    """A plane that ends at a height."""

    above: float = 0.0

    def force(self, chi, chi_dot):
        return super().force(chi, chi_dot) * (chi[..., 2] > self.above)[..., None]

    def penetration(self, chi):
        return super().penetration(chi) * (chi[..., 2] > self.above)


@pytest.mark.parametrize(("surface", "all_of_them"), [
    (UnilateralPlane(point=np.array([100.0, 0.0, 0.0]), stiffness=900.0), True),
    (UnilateralPlane(point=np.array([-9.0, 0.0, 0.0]), stiffness=900.0), True),
    (UnilateralPlane(point=np.array([0.05, 0.0, 0.0]), stiffness=0.1), True),
    (Bounded(point=np.array([0.05, 0.0, 0.0]), stiffness=900.0, dissipation=0.5, above=-0.03),
     False)])
def test_a_place_of_the_path_at_which_nothing_was_evaluated_is_none_of_the_class(
        surface, all_of_them):
    """Too far off, behind the tip, too soft to touch, or ending beside the path."""
    found = compared(surface=surface)
    assert NOT_FOUND in found and set(found) <= {NOT_FOUND, "clearance"}
    specified, observed = found[NOT_FOUND]
    assert observed == specified if all_of_them else 0 < observed < specified
    assert (f"surface not found along the path, at {observed:g} of its {specified:g} places"
            in in_words(found))
    scenario = replace(uv.load_scenario(MAIN), surface=surface)
    assert "surface not found" in certify(scenario).failed.name


def test_a_surface_of_ones_own_is_compared_by_its_law():
    """Its slope at the largest force F, kδ(1 + cδ²) = F, is k(1 + 3cδ²)."""
    roots = np.roots([900.0 * 900.0, 0.0, 900.0, -45.0])
    depth = float(roots[np.isreal(roots)].real[0])
    plane = Harder(point=np.array([0.05, 0.0, 0.0]), stiffness=900.0, dissipation=0.5)
    ((key, departure),) = compared(surface=plane).items()
    assert key == "stiffness"
    assert departure.observed == pytest.approx(900.0 * (1.0 + 2700.0 * depth**2), rel=0.12)


def test_a_bend_on_the_way_of_a_mission_is_found_where_both_ends_are_flat():
    """A cylinder across the slide turns its normal by the arc sine of length over radius."""
    leg = {"point": [-0.17, 0.0, 0.05], "normal": [-1.0, 0.0, 0.0], "axis": [0.0, 1.0, 0.0]}
    base = uv.load_scenario("girona500_inspection")
    for radius, bent in ((0.8, True), (40.0, False)):
        surface = replace(base.surface, geometry=Cylinder(
            **{key: np.array(value) for key, value in leg.items()}, radius=radius))
        assert ("angle" in compared(scenario="girona500_inspection", surface=surface)) == bent


@pytest.mark.parametrize("seed", range(12))
def test_no_wall_that_is_drawn_from_the_class_is_said_to_be_outside(seed):
    scenario = uv.load_scenario(MAIN)
    contact, (start, goal) = scenario.contact.declared_wall(), ends(
        scenario, scenario.contact.declared_wall())
    wall = draw_wall(contact, start + 0.2 * contact.direction, goal, np.random.default_rng(seed))
    if wall is not None:
        assert compared(surface=wall) == {}


def test_known_surfaces_declare_no_class():
    assert compared(scenario="girona500_ideal") == {}


def test_it_is_a_condition_that_fails_before_any_search(monkeypatch):
    monkeypatch.setitem(STAGES, "constants", lambda draft: pytest.fail("something was computed"))
    found = certify(uv.load_scenario(MAIN, ["surface.law.stiffness=1500"]))
    assert [each.holds for each in found.conditions].count(False) == 1
    assert found.verdict.startswith(
        "not certified: surface, which is outside of its declared class: contact.stiffness "
        "declares 1000, it is 149")


@pytest.mark.parametrize(("scenario", "override", "said"), [
    (MAIN, "surface.law.stiffness=1500", "surface, which is outside of its declared class: "),
    ("girona500_real_loop", "seed=0", "sensing[0], ")])
def test_a_certified_run_is_refused_at_once_with_the_way_out_first(
        scenario, override, said, monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(STAGES, "constants", lambda draft: pytest.fail("something was computed"))
    assert main(["run", scenario, "--set", override, "--output", str(tmp_path / "out")]) == 1
    err = capsys.readouterr().err
    assert err.index(": --uncertified runs it with its declared tube, and ") < err.index(
        "; not certified: ")
    assert said in err
    assert not (tmp_path / "out").exists()


def test_an_uncertified_run_a_check_and_certify_say_it_first(tmp_path, capsys):
    file = tmp_path / "stiff.yaml"
    file.write_text(f"base: {MAIN}\nsurface: {{law: !Linear {{stiffness: 1500.0}}}}\n"
                    "duration: 0.1\n", encoding="utf-8")
    words = ("the scenario's own surface is outside of its declared class: contact.stiffness "
             "declares 1000, it is 149")
    assert main(["certify", str(file), "--output", str(tmp_path / "a")]) == 1
    out, err = capsys.readouterr()
    assert err.startswith(words) and "not certified: surface, which is outside" in out
    assert main(["run", str(file), "--uncertified", "--no-figures", "--no-replay", "--quiet",
                 "--output", str(tmp_path / "b")]) == 0  # It never comes to the wall.
    assert capsys.readouterr().err.startswith(words)
    assert main(["scenario", "--check", str(file)]) == 0
    out = capsys.readouterr().out
    assert out.index(words.removeprefix("the scenario's own")) < out.index("(base: ")
