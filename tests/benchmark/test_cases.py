"""Cases and draws: the same for every controller, and what their names say."""

import numpy as np
import pytest

from uvms_drake.benchmark.cases import CASES, ROBOTS, drawn_case
from uvms_drake.station.problem import true_surface
from uvms_drake.station.scenario.contact import SensedContact
from uvms_drake.station.scenario.scenario import dump_scenario


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_draw_is_a_function_of_seed_and_index_alone(robot):
    first, again, other = (dump_scenario(drawn_case(robot, CASES["thrusters"], seed, index)[0])
                           for seed, index in ((3, 1), (3, 1), (3, 2)))
    assert first == again != other


def test_cases_share_their_draw_and_differ_as_named():
    plain, _ = drawn_case("girona500_arm5e", CASES["thrusters"], 1, 0)
    assert 0.05 <= plain.actuation[1].lag <= 0.15
    for name, ratio in (("soft", 0.2), ("stiff", 5.0), ("very_stiff", 20.0)):
        scenario, _ = drawn_case("girona500_arm5e", CASES[name], 1, 0)
        assert true_surface(scenario).law.stiffness == pytest.approx(
            ratio * true_surface(plain).law.stiffness)
        assert scenario.start.config == pytest.approx(plain.start.config)
        assert scenario.actuation[1].lag == plain.actuation[1].lag
    tilted, _ = drawn_case("girona500_arm5e", CASES["tilt"], 1, 0)
    normal = np.asarray(true_surface(tilted).geometry.normal)
    assert np.degrees(np.arccos(-normal[0])) == pytest.approx(5.0, abs=0.01)
    assert drawn_case("girona500_arm5e", CASES["slide"], 1, 0)[1].slide == pytest.approx(
        [0.0, 0.5, 0.0])
    impulse = drawn_case("girona500_arm5e", CASES["impulse"], 1, 0)[1].impulse
    assert np.flatnonzero(impulse).tolist() == [1]


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("case", CASES.values(), ids=lambda case: case.name)
def test_every_case_can_be_drawn(robot, case):
    scenario, events = drawn_case(robot, case, 1, 0)
    assert scenario.model == robot
    assert isinstance(scenario.contact, SensedContact)
    assert events.end(np.inf) == events.latest < scenario.duration
    assert events.end(4.0) == 4.0 + events.after <= scenario.duration
    moved = events.slide_start + np.linalg.norm(events.slide) / events.slide_speed
    assert not np.any(events.slide) or moved == pytest.approx(events.after)
