"""What several test files share: the robot, its model, its MPC problem and differences."""

import os
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # As the command line does.

import numpy as np
import pytest
import yaml
from support.quick import search_less

from uvms_drake.control.ocp.ocp import Ocp
from uvms_drake.control.plan.plan import Plan
from uvms_drake.model.contact_model import ContactModel
from uvms_drake.model.robot import Robot
from uvms_drake.model.surface.law import check_surface
from uvms_drake.model.surface.plane import UnilateralPlane
from uvms_drake.model.uvms import Uvms
from uvms_drake.station.problem import make_ocp
from uvms_drake.station.scenario.scenario import load_scenario

GIRONA, BLUEROV = "girona500_arm5e", "bluerov2_alpha5"
STIFFNESS = 1000.0  # N/m


SMOKE = {
    "common/test_errors.py", "common/test_schema.py",
    "model/test_coordinates.py", "plant/test_disturbance.py",
    "control/test_tube_mpc.py", "sensing/test_faults.py",
    "mission/test_mission.py", "actuation/test_actuators.py", "tube/test_conditions.py",
    "station/test_record.py", "station/test_signals.py",
    "certificate/test_certificate.py", "report/test_summary.py", "report/test_log_export.py",
    "command/test_progress.py", "visual/test_server.py"}
"""Files of the smoke subset (`pytest -m smoke`), one or two of every room, without slow tests."""
DEAREST = {
    "test_tutorials.py", "certificate/test_certify.py", "command/test_drawn_runs.py",
    "command/test_fuzz.py", "control/ocp/test_scp.py", "identification/test_identify.py",
    "loop/test_controller.py", "setup/test_first_scenario.py", "tube/test_covering.py",
    "tube/test_terminal_set.py"}
"""Files that take longest: each is of one process, so that they begin first."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Makes the tests that are `long` slow, too, marks the smoke subset, and lets slow ones begin.

    So the last tests to run are short, and all processes end together.
    """
    def path_of(item) -> str:
        return item.path.relative_to(Path(__file__).parent).as_posix()

    for item in items:
        path = path_of(item)
        if path in SMOKE and not any(map(item.get_closest_marker, ("slow", "long"))):
            item.add_marker(pytest.mark.smoke)
        if item.get_closest_marker("long"):
            item.add_marker(pytest.mark.slow)
    items.sort(key=lambda item: (item.get_closest_marker("slow") is None,
                                 path_of(item) not in DEAREST))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Gives a file to one process, so that what its tests share is made once; `--dist` decides."""
    from xdist.scheduler import LoadFileScheduling
    config.option.loadscopereorder = False  # It would be by the number of tests in a file.
    return LoadFileScheduling(config, log) if config.getoption("dist") == "load" else None


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory) -> Iterator[Path]:
    """A cache of the tests' own, for all processes: they compute a certificate once."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        yield folder / "cache"


@pytest.fixture(scope="session")
def girona_robot() -> Robot:
    """The Girona 500 with its arm."""
    return Robot.load(GIRONA)


@pytest.fixture(scope="session")
def girona(girona_robot: Robot) -> Uvms:
    """The same in a plant of its own."""
    return girona_robot.uvms


@pytest.fixture(scope="session")
def uvms(girona: Uvms) -> Uvms:
    """The robot of the tests; a file may have another one."""
    return girona


@pytest.fixture(scope="session", autouse=True)
def parsed_once(girona_robot: Robot) -> Iterator[None]:
    """What takes half of a short run is done once for all tests: to parse YAML and the robot."""
    known: dict[tuple, bytes] = {}

    def once(parse: Callable) -> Callable:
        def parsed(stream, Loader):
            text = stream if isinstance(stream, str | bytes) else stream.read()
            if (key := (parse, text, Loader)) not in known:
                if text is not stream:
                    stream.seek(0)
                known[key] = pickle.dumps(parse(stream, Loader=Loader))
            return pickle.loads(known[key])
        return parsed

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(yaml, "load", once(yaml.load))
        patch.setattr(yaml, "compose", once(yaml.compose))
        load, robots = Robot.load, {GIRONA: girona_robot}

        def loaded(model) -> Robot:
            if model == BLUEROV and model not in robots:
                robots[model] = load(model)
            return robots[model] if model in (GIRONA, BLUEROV) else load(model)
        patch.setattr(Robot, "load", staticmethod(loaded))
        yield


@pytest.fixture(scope="module")
def few_searches() -> Iterator[None]:
    """Certificates with the settings `FEW` take fewer searches too, in all tests of a file."""
    with pytest.MonkeyPatch.context() as patch:
        search_less(patch)
        yield


@pytest.fixture(scope="session")
def plane() -> UnilateralPlane:
    """The wall of the ideal scenario: at x = 0, facing −x."""
    return UnilateralPlane(stiffness=STIFFNESS)


@pytest.fixture(scope="session")
def model(uvms: Uvms, plane: UnilateralPlane) -> ContactModel:
    """The prediction model in front of a wall of 1000 N/m."""
    return ContactModel(uvms, check_surface(plane))


@pytest.fixture(scope="session")
def ocp() -> Ocp:
    """The MPC problem of the ideal scenario."""
    return make_ocp(load_scenario("girona500_ideal"))


@pytest.fixture(scope="session")
def derivative() -> Callable:
    """The central difference of fourth order, d/ds g(s) at s = 0."""
    def five_point(g: Callable[[float], np.ndarray], step: float = 1e-3) -> np.ndarray:
        return (8.0 * (g(step) - g(-step)) - (g(2.0 * step) - g(-2.0 * step))) / (12.0 * step)
    return five_point


@pytest.fixture(scope="session")
def states(model: ContactModel) -> dict[str, np.ndarray]:
    """States (𝔮, ζ) (8, 20) with the tip away from the wall, in its soft skin, and deep in it."""
    rng = np.random.default_rng(seed=10)
    out = {}
    for name, depth in (("free", -0.2), ("skin", 0.001), ("deep", 0.012)):
        scatter = rng.uniform(-1.0, 1.0, size=(8, 10))
        y = scatter * np.array([0.0005, 1.0, 1.0, 0.4, 0.4, 0.4, 0.4, 0.3, 0.3, 1.0])
        y += np.array([depth, 0.0, 0.0, 0.0, 0.0, 0.0, 0.2, 0.9, 0.2, 0.0])
        zeta = rng.uniform(-1.0, 1.0, size=(8, 10)) * np.repeat([0.25, 0.2, 0.4], [3, 3, 4])
        out[name] = np.hstack([model.configuration(y), zeta])
    return out


@pytest.fixture(scope="session")
def short_ocp() -> Ocp:
    """The MPC problem of the ideal scenario with a horizon of 5 intervals, 1 s."""
    return make_ocp(load_scenario("girona500_ideal", ["mpc.horizon=5"]))


@pytest.fixture(scope="session")
def start_plans(short_ocp: Ocp) -> dict[str, list[Plan]]:
    """First guesses from random feasible states: 10 off, 10 on, and 4 just before the wall.

    The vehicle is nearly level, for its limited inputs cannot hold a large roll or pitch; all
    velocities are within their limits.
    """
    model, rng = short_ocp.model, np.random.default_rng(0)
    plans: dict[str, list[Plan]] = {"off": [], "on": [], "before": []}
    depths = {"off": (-0.4, -0.25), "before": (-0.08, -0.02), "on": (0.015, 0.03)}
    for where in [*(["off", "on"] * 10), *(["before"] * 4)]:
        config = model.configuration(short_ocp.y_des) + rng.uniform(-1.0, 1.0, size=10) * np.array(
            [0.0, 0.1, 0.1, 0.03, 0.03, 0.1, 0.1, 0.1, 0.1, 0.2])
        config[0] += rng.uniform(*depths[where]) - model.task_pose(config)[0]
        zeta = rng.uniform(-1.0, 1.0, size=10) * np.repeat([0.05, 0.03, 0.06], [3, 3, 4])
        plans[where].append(short_ocp.resting_plan(0.0, np.concatenate([config, zeta])))
    return plans
