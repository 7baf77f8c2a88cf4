"""A first scenario's own numbers: none of another robot's, with its certificate's advice put in."""

import json
import re

import numpy as np
import pytest
from support.pages import ROOT
from support.quick import few_in_all_files

import uvms_drake as uv
from uvms_drake.command.main import main
from uvms_drake.common.schema import parse_yaml
from uvms_drake.model.uvms_model import configuration_rate
from uvms_drake.report.compare import differing_keys
from uvms_drake.setup import first_scenario as module
from uvms_drake.setup.first_scenario import first_scenario, format_first_scenario
from uvms_drake.setup.settle import with_settings
from uvms_drake.station.problem import check_inputs
from uvms_drake.station.scenario.scenario import typed_scenario
from uvms_drake.tube.row_gains import resolved_tube

SMALL = ROOT / "tests" / "field_cases" / "small_robot" / "small.urdf"
ROBOTS = ("box_uvms", "bluerov2_alpha5", "girona500_arm5e")
ANY_ROBOT = re.compile(
    r"description|seed|duration|log_period|certificate\.|simulator\.|mpc\.iterations|current|"
    r"base|name|visual")
"""Keys that say nothing about a robot."""


def text_of(robot: str) -> str:
    return format_first_scenario(first_scenario(uv.read_uvms(robot), 5.0), robot, robot)


@pytest.mark.parametrize("robot", ROBOTS)
def test_no_number_is_that_of_the_robot_of_the_base(robot, tmp_path):
    """Without its base a file says the same but for keys that are about no robot."""
    text = text_of(robot)
    with_base = tmp_path / "press.yaml"
    with_base.write_text(text, encoding="utf-8")
    alone = typed_scenario(parse_yaml(text.replace("base: girona500_ideal\n", "")))
    inherited = differing_keys([uv.load_scenario(str(with_base)), alone])
    assert [key for key in inherited if not ANY_ROBOT.match(key)] == []


def differences(model: uv.UvmsModel, config: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """Returns ∂(position, Euler angles)/∂∫ζ (6, 6+n) of the tip by central differences."""
    def moved(zeta: np.ndarray) -> np.ndarray:
        return model.task_pose(config + configuration_rate(config, zeta))

    return np.stack([(moved(each) - moved(-each)) / (2.0 * step)
                     for each in step * np.eye(model.size)], axis=1)


@pytest.mark.parametrize("robot", ROBOTS)
def test_declared_radii_are_closed_forms_of_the_written_numbers(robot, tmp_path):
    """The rows of J by differences of the pose, over other states."""
    file = tmp_path / "press.yaml"
    file.write_text(text_of(robot), encoding="utf-8")
    scenario = uv.load_scenario(str(file))
    model, tube = check_inputs(scenario), scenario.tube
    d, k = scenario.disturbance.axes(model.size), scenario.ancillary.k
    rng, rows = np.random.default_rng(5), []
    for _ in range(40):
        q = rng.uniform(scenario.limits.q_lower, scenario.limits.q_upper)
        config = np.concatenate([np.zeros(3), rng.uniform(-0.25, 0.25, 2), [0.0], q])
        rows.append(differences(model, config))
    rows = np.array(rows)
    for radius, block in ((tube.position, slice(3)), (tube.orientation, slice(3, 6))):
        norm = np.max(np.linalg.norm(rows[:, block] * d, 2, axis=(1, 2)))
        exact = resolved_tube(k, k, 1.0, norm).e
        assert 0.98 * exact < radius < 1.4 * exact
    assert tube.joints == pytest.approx(1.1 * np.max(d[6:]) / k**2, rel=5e-2)
    assert tube.z == pytest.approx(np.linalg.norm([tube.nu1, tube.nu2, tube.qdot]), rel=5e-3)


@pytest.mark.parametrize(("key", "value"), [
    ("limits.roll", "0.31"), ("limits.pitch", "0.32"), ("limits.tip_pitch", "0.6"),
    ("limits.static_force", "77.5"), ("limits.q_lower", "[-1.1,0.2]"),
    ("limits.q_upper", "[0.1,1.9]"), ("mpc.horizon", "23"), ("certificate.safety_factor", "1.31"),
    ("certificate.seed", "7")])
def test_an_advice_is_written_in_its_line(key, value, tmp_path):
    before, file = text_of("box_uvms"), tmp_path / "press.yaml"
    text = with_settings(before, {key: value})
    new = len(text.splitlines()) - len(before.splitlines())
    assert new == (key == "certificate.seed")
    differing = [line for line in text.splitlines() if line not in before.splitlines()]
    assert differing == [f"  {key.partition('.')[2]}: {value}  # by advice of the certificate"]
    file.write_text(text, encoding="utf-8")
    section, _, name = key.partition(".")
    found = getattr(getattr(uv.load_scenario(str(file)), section), name)
    np.testing.assert_allclose(np.asarray(found, dtype=float), json.loads(value))


def test_a_key_without_a_section_is_written_in_its_line_or_a_new_one():
    assert with_settings("a: 1.0   # s\nb:\n  a: 2\n", {"a": "3"}, "longer") == (
        "a: 3  # longer\nb:\n  a: 2\n")
    assert with_settings("b:\n  a: 2\n", {"a": "3"}, "new") == "b:\n  a: 2\n\na: 3  # new\n"


@pytest.mark.slow
def test_the_advice_of_its_certificate_is_taken_until_it_certifies(tmp_path, monkeypatch, capsys):
    """A disturbance beyond what the limits of the inputs have been made for."""
    few_in_all_files(monkeypatch)
    monkeypatch.setattr(module, "TAKEN", 1.8)
    monkeypatch.setattr(module, "SPARE", 0.05)
    monkeypatch.setattr(module, "MOST", (0.05, 0.1, 0.5))
    command = ["scenario", "--robot", "box_uvms", "--quiet", "--new"]
    assert main([*command, str(tmp_path / "press.yaml")]) == 0
    assert "; certified: all " in capsys.readouterr().out
    assert main([*command, str(tmp_path / "plain.yaml"), "--uncertified"]) == 0
    settled, plain = (uv.load_scenario(str(tmp_path / name)) for name in (
        "press.yaml", "plain.yaml"))
    assert settled.disturbance.bound < 0.95 * plain.disturbance.bound
    assert "% of a current" in (tmp_path / "press.yaml").read_text("utf-8")
    assert not uv.certify(plain).certified
    found = uv.certify(settled)
    assert found.certified
    np.testing.assert_allclose(settled.tube.u, found.tube.u, rtol=6e-3)
    assert settled.mpc.terminal_radius == pytest.approx(found.terminal.radius, rel=6e-3)


@pytest.mark.long
def test_a_small_robot_stays_within_its_declared_tube(tmp_path, monkeypatch, capsys):
    """At the bound of its disturbance, by the closed forms and by its certificate's radii."""
    few_in_all_files(monkeypatch)
    monkeypatch.chdir(tmp_path)
    assert main(["robot", "--from", str(SMALL), "r"]) == 0
    for name, option in (("plain", ["--uncertified"]), ("press", [])):
        assert main(["scenario", "--new", f"{name}.yaml", "--robot", "r", *option]) == 0
        assert main(["run", f"{name}.yaml", "--uncertified", "--duration", "3", "--no-figures",
                     "--no-replay", "--quiet"]) == 0
        summary = json.loads((tmp_path / "out" / name / "summary.json").read_text("utf-8"))
        assert 0.1 < summary["tube"]["worst_ratio"]["set"] < 0.9, name
        assert summary["tube"]["exits"] == 0
    capsys.readouterr()
