"""Runs against surfaces that are put together, from files."""

import numpy as np
import pytest

import uvms_drake as uv
from uvms_drake.command.main import main
from uvms_drake.station.scenario.scenario import dump_scenario

FILE = """
base: girona500_ideal
duration: 0.5
limits: {{static_force: null}}
simulator: {{max_step_size: 0.01}}
task: {{force: {force}}}
surface: !ShapedSurface
  creep: 0.04
  {surface}
"""
SURFACES = {
    "plane": "geometry: !Plane {normal: [-0.96, 0.0, 0.28]}\n  law: !Bilinear {ratio: 2}",
    "hull": "geometry: !Cylinder {radius: 0.4}\n  law: !Hardening {ratio: 3}\n  friction: 0.3",
    "pipe": "geometry: !Cylinder {radius: 0.6, inside: true, axis: [0, 0.6, 0.8]}\n  friction: 0",
    "bumpy": "geometry: !Bumpy {amplitude: 0.01, seed: 5}\n  dissipation: 4"}


def scenario_of(path, name):
    """Writes a file in which the tip starts at rest, 5 mm off the task and aside, and loads it."""
    path.write_text(FILE.format(force=[20.0, 0, 0, 0, 0, 0], surface=SURFACES[name]))
    surface = uv.load_scenario(str(path)).surface
    _, into = surface.geometry.depth_and_gradient(np.zeros(3))
    force = 20.0 * into / np.linalg.norm(into)
    path.write_text(FILE.format(force=[*force.tolist(), 0, 0, 0], surface=SURFACES[name]))
    ocp = uv.make_ocp(uv.load_scenario(str(path)))
    lengths = surface.geometry.local_lengths(surface.geometry.local(ocp.y_des[:3]))
    off = surface.geometry.point_at(lengths + [0.02, 0.02], -0.005)
    config = ocp.model.configuration(np.concatenate([off, ocp.y_des[3:]]))
    with path.open("a") as file:
        file.write(f"start: {{eta: {config[:6].tolist()}, q: {config[6:].tolist()}}}\n")
    return uv.load_scenario(str(path))


@pytest.mark.parametrize("name", [
    "hull", "bumpy", *(pytest.param(name, marks=pytest.mark.long) for name in ("plane", "pipe"))])
def test_a_run_touches_a_surface_of_any_kind(tmp_path, name):
    scenario = scenario_of(tmp_path / "mine.yaml", name)
    assert main(["run", str(tmp_path / "mine.yaml"), "--uncertified", "--no-figures",
                 "--output", str(tmp_path / "out")]) == 0
    record = uv.load_record(tmp_path / "out")
    assert isinstance(record.scenario.surface, uv.ShapedSurface)
    assert dump_scenario(record.scenario) == dump_scenario(scenario)
    surface = record.scenario.surface.checked()
    depth, into = surface.geometry.depth_and_gradient(record.chi[:, :3])
    assert depth[0] == pytest.approx(-0.005, abs=1e-4)
    np.testing.assert_allclose(record.penetration, np.maximum(depth, 0.0), atol=1e-12)
    normal = into / np.linalg.norm(into, axis=1)[:, None]
    along = np.sum(record.force[:, :3] * normal, axis=1)
    across = np.linalg.norm(record.force[:, :3] - along[:, None] * normal, axis=1)
    assert np.max(along) > 3.0
    assert np.all(across <= surface.friction * along + 1e-9)
    assert (np.max(across) > 0.1) == (surface.friction > 0.0)
    assert (tmp_path / "out" / "replay.html").is_file()
