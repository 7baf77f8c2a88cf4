"""A scenario made of objects: the same as that of a file, turned with its wall, refused by name."""

from dataclasses import dataclass
from operator import attrgetter

import numpy as np
import pytest
from support.surfaces import Sphere

import uvms_drake as uv
from uvms_drake.command.main import main
from uvms_drake.model.frames.euler import rotation_matrix

GIRONA = "girona500_arm5e"
POSTURE = [0.0, 1.1, 0.47, 0.0]  # rad


@pytest.mark.parametrize("robot", ["box_uvms"])
def test_it_is_the_scenario_of_the_file_that_the_command_writes(robot, tmp_path):
    file = tmp_path / "press.yaml"
    assert main(["scenario", "--new", str(file), "--robot", robot, "--force", "6",
                 "--uncertified"]) == 0
    written, made = uv.load_scenario(str(file)), uv.make_scenario(robot, force=6.0)
    assert (made.model, made.mpc.horizon) == (written.model, written.mpc.horizon)
    for key in ("limits.u", "limits.q_lower", "limits.static_force", "start.eta", "start.q",
                "task.force", "task.pose", "task.posture", "mpc.weight_u", "disturbance.weights",
                "ancillary.k", "surface.stiffness", "tube.u", "tube.e", "tube.position", "tube.nu1",
                "mpc.terminal_radius"):
        now, before = (attrgetter(key)(each) for each in (made, written))
        np.testing.assert_allclose(now, before, rtol=1e-3, atol=1e-4, err_msg=key)


def test_it_takes_a_kind_of_contact_with_the_sensor_that_it_needs():
    sensor = uv.sensors.ForceSensor(rate=500.0, lag=0.004)
    contact = uv.SensedContact(force=20.0, angle=0.08, speed=0.06, delay=0.03)
    press = uv.make_scenario(GIRONA, uv.UnilateralPlane(stiffness=900.0), force=5.0,
                             posture=POSTURE, contact=contact, sensing=[sensor])
    press.duration = 0.04
    assert uv.simulate(press).signals["touched"].max() == 0.0
    with pytest.raises(uv.InvalidParameter, match="a part that measures the force"):
        uv.make_scenario(GIRONA, force=5.0, posture=POSTURE, contact=contact)


def test_with_a_wall_that_is_turned_the_start_turns_and_the_input_at_rest_stays():
    yaw, place = 0.8, np.array([1.0, -2.0, 3.0])
    turn = rotation_matrix(np.array([0.0, 0.0, yaw]))
    plain = uv.make_scenario(GIRONA, uv.UnilateralPlane(), force=12.0, posture=POSTURE)
    wall = uv.UnilateralPlane().moved(turn, place)
    turned = uv.make_scenario(uv.Robot.load(GIRONA), wall, force=12.0, posture=POSTURE)
    np.testing.assert_allclose(turned.task.force[:3], turn @ plain.task.force[:3], atol=1e-9)
    ocps = [uv.make_ocp(each) for each in (plain, turned)]
    configs = [ocp.model.configuration(ocp.y_des) for ocp in ocps]
    np.testing.assert_allclose(configs[1][:3], turn @ configs[0][:3] + place, atol=1e-3)
    np.testing.assert_allclose(configs[1][3:], configs[0][3:] + [0, 0, yaw, 0, 0, 0, 0], atol=1e-3)
    np.testing.assert_allclose(ocps[1].u_eq, ocps[0].u_eq, atol=1e-3)
    np.testing.assert_allclose(turned.limits.u, plain.limits.u, rtol=2e-2)
    tips = [each.model.task_pose(scenario.start.config)[:3]
            for each, scenario in zip(ocps, (plain, turned), strict=True)]
    assert tips[0] @ [1, 0, 0] == pytest.approx(-0.2, abs=0.01)
    assert (tips[1] - place) @ turn[:, 0] == pytest.approx(-0.2, abs=0.01)


def test_the_default_pose_of_a_surface_is_where_it_gives_the_force():
    ball = Sphere()
    chi = ball.pose_for(np.array([8.0, 0.0, 0.0, 0.0, 0.0, 0.0]), np.array(
        [-1.01, 0.0, 0.0, 0.0, 0.2, 0.0]))
    np.testing.assert_array_equal(chi[1:], [0.0, 0.0, 0.0, 0.2, 0.0])
    assert 500.0 * (1.0 + chi[0]) * -chi[0] == pytest.approx(8.0)
    with pytest.raises(uv.InvalidParameter, match="one that the surface gives along its direction"):
        ball.pose_for(np.array([0.0, 8.0, 0.0, 0.0, 0.0, 0.0]), chi)
    attitudes = np.zeros((50, 6))
    attitudes[:, :3] = ball.sample_contact(attitudes, 2.0, np.random.default_rng(0))
    forces = ball.static_force(attitudes)
    assert np.max(forces) <= 2.0
    assert np.count_nonzero(forces) > 10


def test_a_surface_and_a_law_of_ones_own_run():
    @dataclass
    class Stiffer(uv.AncillaryLaw):
        gain: float = 90.0

        def command(self, model, now, nominal_acceleration, nominal_input):
            error = now.inverse @ uv.pose_difference(*now.y)
            return nominal_input() - self.gain * error - 20.0 * (now.zeta[0] - now.zeta[1])

    press = uv.make_scenario(GIRONA, Sphere(), force=[8.0, 0.0, 0.0], posture=POSTURE,
                             law=Stiffer(), disturbance=0.01, distance=0.02)
    press.duration = 2.5
    record = uv.simulate(press)
    assert record.force[-1, 0] == pytest.approx(8.0, abs=1.0)
    assert record.summary()["scenario"] == "press"


@pytest.mark.parametrize(("arguments", "expected"), [
    ({"force": 0.0}, "force = 0.0: must be positive"),
    ({"force": "hard"}, "force = 'hard': must be 3 finite numbers"),
    ({"law": 3}, "law = 3: must be of the type AncillaryLaw"),
    ({"surface": Sphere()}, "force = 10.0: must be a vector (3,) in Σ_I"),
    ({"surface": uv.UnilateralPlane(stiffness=-1.0)}, "surface.stiffness = -1.0: must be positive"),
    ({"surface": uv.UnilateralPlane(normal=[0.0, 0.0, -1.0])},
     "surface.normal = [ 0., 0., -1.]: must be within 0.35 rad of opposite to the tool"),
    ({"posture": [0.0]}, "posture = [0.0]: must be 4 finite numbers"),
    ({"distance": 0.0}, "distance = 0.0: must be positive"),
    ({"robot": "submarine"}, "model = 'submarine': must be one of")])
def test_an_argument_without_meaning_is_named(arguments, expected):
    with pytest.raises(uv.InvalidParameter) as caught:
        uv.make_scenario(**{"robot": GIRONA, "force": 10.0, "posture": POSTURE} | arguments)
    assert " ".join(str(caught.value).split()).startswith(expected)


def test_a_disturbance_that_the_thrusters_cannot_reject_is_taken_with_a_warning(caplog):
    uv.make_scenario(GIRONA, force=12.0, posture=POSTURE, disturbance=0.001)
    assert caplog.text == ""
    uv.make_scenario(GIRONA, force=12.0, posture=POSTURE, disturbance=0.05)
    assert "limits.u of girona500_arm5e is that of an ideal wrench" in caplog.text
    assert "along sway" in caplog.text


@pytest.mark.long
def test_the_readmes_problem_certifies_and_its_plant_and_controller_press():
    wall = uv.UnilateralPlane(stiffness=2000.0)
    press = uv.make_scenario(GIRONA, wall, force=12.0, posture=POSTURE,
                             law=uv.Resolved(k=20.0, sigma=5.0), disturbance=0.05)
    certificate = uv.certify(press)
    assert certificate.certified
    press = certificate.applied_to(press)
    press.duration = 6.0
    record = uv.simulate(press, certified=True)
    assert np.max(record.deviation_of("position")) < certificate.tube.position
    assert record.force[-1, 0] == pytest.approx(12.0, abs=certificate.bounds["force"])


def test_a_place_of_ones_own_counts_without_a_surface_too():
    place = [0.0, 0.5, 1.0]
    press = uv.make_scenario("girona500_arm5e", force=12.0, place=place)
    np.testing.assert_array_equal(press.task.pose[:3], place)
    at_origin = uv.make_scenario("girona500_arm5e", force=12.0)
    np.testing.assert_allclose(press.start.eta[:3] - at_origin.start.eta[:3], place, atol=1e-5)
