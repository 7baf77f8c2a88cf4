"""Random scenario files: exit status 0, 2, 3 or 4, one line for an error, never more.

Status 1 is for a run that was started from values that mean something and could not be carried
through. Every case is a function of its number, so that one that fails can be looked at alone.
"""

import copy
import os
import signal

import numpy as np
import pytest
from pydrake.common.yaml import yaml_dump, yaml_load_data
from support.refusals import OBJECT

from uvms_drake.command.main import main
from uvms_drake.station.scenario.scenario import dump_scenario, load_scenario
from uvms_drake.station.scenario.scenario_file import shipped_scenarios

pytestmark = pytest.mark.slow

CASES = int(os.environ.get("UVMS_DRAKE_FUZZ", "120"))
FIRST = int(os.environ.get("UVMS_DRAKE_FUZZ_FIRST", "0"))
"""Number of the first case: others than the usual ones are looked at by another one."""
CHUNKS = 6
SECONDS = 20
"""A case that takes longer does not come back."""
VALUES = (
    None, True, False, 0, 1, -1, 3, 2**63, -(10**400), 0.5, -0.5, 1e-3, 1e6, 1e30, 1e308, -1e308,
    5e-324, float("nan"), float("inf"), "", "1e-3", "nan", "text", "ζ\u0000\u202e", "../..", "a/b",
    "!UnilateralPlane", [], {}, [0], [1.0, 2.0, 3.0], [0.0] * 6, [1e308] * 6, [1.0] * 10,
    [[1.0, 0.0], [0.0]], np.eye(6).tolist(), np.zeros((10, 10)).tolist(), [None], ["x"],
    {"_tag": "!Resolved"}, {"_tag": "!ConstantDisturbance", "bound": 0.01},
    {"_tag": "!AdversarialDisturbance", "kind": "leading", "rows": "joints"}, {"_tag": "!No"},
    {"a": {"b": {"c": []}}})
FAULTS = (
    [{"_tag": "!SolverFailure"}], [{"start": 0.01}], [{"_tag": "!DroppedPeriod", "duration": None}],
    [{"_tag": "!FrozenState", "duration": 1e6}], [{"_tag": "!LostState"}],
    [{"_tag": "!LostState", "start": 0.004}], [{"_tag": "!StuckJoint", "joint": 3}],
    [{"_tag": "!StuckJoint", "joint": 2**63}], [{"_tag": "!ExcessDisturbance", "factor": 1e30}],
    [{"_tag": "!SolverTimeout"}, {"_tag": "!SolverTimeout"}], [{"_tag": "!Fault"}], [None], {},
    [{"_tag": "!FrozenState", "start": 1e30}, {"_tag": "!SolverFailure", "probability": -1}])
KEYS = ("", "a", "0", "_x", "name", "seed", "mpc", "é\n", "limits.u", "~", "- -", "_tag")


class Stuck(BaseException):
    """A case took too long; an Exception would be a failure of the run."""


def paths_of(data, here=()):
    """Returns the paths of all entries of nested mappings and lists."""
    items = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in items:
        yield (*here, key)
        if isinstance(value, dict | list):
            yield from paths_of(value, (*here, key))


def mutated(data, rng):
    """Returns data with one entry replaced, scaled, renamed, added or taken out."""
    data = copy.deepcopy(data)
    paths = list(paths_of(data))
    if not paths:
        return data
    path = paths[rng.integers(len(paths))]
    owner = data
    for key in path[:-1]:
        owner = owner[key]
    last = path[-1]
    match rng.integers(6):
        case 0 | 1:
            owner[last] = copy.deepcopy(VALUES[rng.integers(len(VALUES))])
        case 2 if isinstance(owner[last], float):
            owner[last] *= float(10.0 ** rng.uniform(-6.0, 6.0) * rng.choice([-1.0, 1.0]))
        case 3 if isinstance(owner, dict):
            owner[KEYS[rng.integers(len(KEYS))]] = owner.pop(last)
        case 4:
            del owner[last]
        case _:
            extra = copy.deepcopy(VALUES[rng.integers(len(VALUES))])
            if isinstance(owner, dict):
                owner[KEYS[rng.integers(len(KEYS))]] = extra
            else:
                owner.append(extra)
    return data


def damaged(content: bytes, rng) -> bytes:
    """Returns a text that was cut off, or with bytes or lines changed, doubled or taken out."""
    lines = content.splitlines(keepends=True)
    i = int(rng.integers(len(lines)))
    match rng.integers(6):
        case 0:
            return content[: rng.integers(len(content))]
        case 1:
            return rng.bytes(int(rng.integers(1, 400)))
        case 2:
            array = np.frombuffer(content, dtype=np.uint8).copy()
            where = rng.integers(len(array), size=rng.integers(1, 9))
            array[where] = rng.integers(256, size=len(where))
            return array.tobytes()
        case 3:
            return b"".join([*lines[:i], *lines[i + 1:]])
        case 4:
            return b"".join([*lines[:i], lines[i], *lines[i:]])
        case _:
            return content.replace(b"  ", b"\t", 1) if i % 2 else content + b"\n" + lines[i]


def case(number: int) -> bytes:
    """Returns the content of a file."""
    rng = np.random.default_rng(number)
    names = list(shipped_scenarios())
    name = names[rng.integers(len(names))]
    if rng.uniform() < 0.4:
        return damaged(shipped_scenarios()[name].read_bytes(), rng)
    data = yaml_load_data(dump_scenario(load_scenario(name)), private=True)
    for _ in range(rng.integers(1, 4)):
        data = mutated(data, rng)
    if rng.uniform() < 0.2:
        data["faults"] = copy.deepcopy(FAULTS[rng.integers(len(FAULTS))])
    try:
        return yaml_dump(data).encode(errors="replace")
    except Exception:  # A tag that is not a name cannot be written.
        return b"surface: !!python/object:os.system {}\n"


@pytest.fixture
def deadline():
    """Turns a case that hangs into a failure, by processor time: a busy machine is no fault."""
    def expire(signum, frame):
        raise Stuck

    old = signal.signal(signal.SIGPROF, expire)
    yield lambda: signal.setitimer(signal.ITIMER_PROF, SECONDS)
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    signal.signal(signal.SIGPROF, old)


@pytest.mark.parametrize("chunk", range(CHUNKS))
def test_any_file_ends_in_a_run_or_in_one_line(tmp_path, capsys, deadline, chunk):
    failures = []
    for number in range(FIRST + chunk, FIRST + CASES, CHUNKS):
        file, output = tmp_path / f"case{number}.yaml", tmp_path / f"out{number}"
        file.write_bytes(case(number))
        deadline()
        try:
            status = main(["run", str(file), "--duration", "0.02", "--uncertified",
                           "--no-figures", "--no-replay", "--output", str(output)])
        except BaseException as error:
            failures.append((number, repr(error)))
            continue
        err = capsys.readouterr().err
        said = [line for line in err.splitlines() if "error: " in line]
        if status not in (0, 1, 2, 3, 4) or "Traceback" in err or OBJECT.search(err) or (
                len(said) != (status in (1, 2))):
            failures.append((number, status, err))
        if output.exists() != (status in (0, 3, 4)):
            failures.append((number, status, "half-written"))
    assert not failures
