"""Files of scenarios: search path, bases and overrides.

An override is a text such as `surface.stiffness=2000`. Values are checked elsewhere.
"""

import contextlib
import os
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

from uvms_drake.common.errors import (
    InvalidParameter,
    RunFailed,
    ScenarioError,
    require,
    shortened,
)
from uvms_drake.common.program import FOLDER
from uvms_drake.common.schema import parse_yaml, read_yaml, suggestion
from uvms_drake.model.description.robot_files import shipped_robots
from uvms_drake.station.scenario.modules import from_folder

_DRAWN = "left out: drawn runs certify a loop that is not ideal (certify --runs)"
GONE_KEYS = {
    "certificate.plans": _DRAWN,
    "certificate.linear": _DRAWN,
    "contact.turn": "left out: the tool keeps its attitude",
    "mission.reached": "left out: a place is reached within 0.01 m",
    "actuation.sag": "left out: `error` is the error of the thrusters' forces",
    "actuation.foreseen": "left out: !LaggedWrench is !Thrusters with its own lag and dead time",
    "waves.sea_depth": "left out: the water is deep",
    "model_error.joint_friction.stribeck": "left out: it is 0.05 rad/s",
    "mpc.input_reference": "left out: the cost is about the input that holds the task",
    "motion": "left out: forces move the robot; a simulation of its own is named by `simulation`",
}
"""Allowed in place of each key that scenarios once had, as the end of "must be ..."."""
GONE_SCENARIOS = {
    "girona500_sampled": "girona500_contact (ideal), or girona500_real_loop with drawn runs",
    "girona500_lag": "girona500_contact (ideal), or girona500_real_loop with drawn runs",
}
"""Replacement of each scenario that was once shipped."""


def refuse_gone(raw: object, key: str = "") -> None:
    """Raises `InvalidParameter` for the first key in raw data that former versions had."""
    for name, value in raw.items() if isinstance(raw, dict) else ():
        path = f"{key}.{name}" if key else str(name)
        require(path not in GONE_KEYS, path, value, GONE_KEYS.get(path, ""))
        for item in value if isinstance(value, list) else [value]:
            refuse_gone(item, path)


def shipped_scenarios() -> dict[str, Path]:
    """Returns the files of the scenarios that come with the package, by name."""
    folder = FOLDER / "scenarios"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def scenario_path(name_or_path: str, key: str = "scenario") -> Path:
    """Returns the file of a shipped scenario or of a path; a shipped name goes first.

    Args:
        name_or_path: Name of a shipped scenario, or a path.
        key: Key for the message if there is none.
    """
    shipped = shipped_scenarios()
    path = shipped.get(name_or_path, Path(name_or_path))
    if os.path.isfile(path):  # No error for a name that is too long, or with NUL in it.
        return path
    if name_or_path in GONE_SCENARIOS:
        raise ScenarioError(f"{key} = {name_or_path!r}: must be {GONE_SCENARIOS[name_or_path]}; "
                            "it is not shipped any more")
    known = f"one of {', '.join(shipped)}"
    if os.path.exists(path):
        allowed = f"a file: this is {'a folder' if path.is_dir() else 'none'}"
    elif len(path.parts) > 1 or path.suffix in (".yaml", ".yml"):
        allowed = f"a file that exists, or {known}"
    else:
        allowed = f"{known}, or a YAML file that exists"
    raise ScenarioError(f"{key} = {shortened(name_or_path)!r}: must be {allowed}"
                        + suggestion(name_or_path, list(shipped)))


def scenario_source(name_or_path: str, options: Sequence[str] = ()) -> str:
    """Returns the source of a scenario's values, for the end of messages.

    Args:
        name_or_path: As of `load_scenario`.
        options: Words of the command line that change it.
    """
    name = scenario_path(name_or_path).name
    return f"{name} with {shortened(shlex.join(options), 100)}" if options else name


def set_options(overrides: Sequence[str]) -> list[str]:
    """Returns the words of a command line that make the overrides, each in one line."""
    return [word for text in overrides for word in ("--set", " ".join(text.split()))]


@contextlib.contextmanager
def reported_in(source: str) -> Iterator[None]:
    """Names the file in the errors of the block; a bad value becomes a `ScenarioError`."""
    try:
        yield
    except (InvalidParameter, ScenarioError) as error:
        raise ScenarioError(f"{error} ({source})") from None
    except RunFailed as error:
        raise RunFailed(f"{error} ({source})") from error


def with_base(raw: object, path: Path, above: Sequence[Path]) -> object:
    """Returns a file's raw data, with the values of its `base` where it has none.

    Top-level keys that start with an underscore are dropped: they may hold YAML anchors.

    Args:
        raw: Raw data of the file.
        path: The file; paths of a base, of a robot's folder and of modules are relative to its
            folder.
        above: Files of which it is the base.
    """
    if not isinstance(raw, dict) or not raw:
        raise InvalidParameter("the file", raw, "a mapping of keys to values, such as "
                               "`base: girona500_ideal`")
    own = {key: value for key, value in raw.items() if not str(key).startswith("_")}
    robot = own.get("model")
    if isinstance(robot, str) and robot not in shipped_robots() and (
            os.path.isdir(folder := path.parent / robot) and folder.name):
        own["model"] = str(folder)
    if isinstance(own.get("modules"), list):
        own["modules"] = [from_folder(str(each), path.parent) for each in own["modules"]]
    if "base" not in own:
        return own
    base = own.pop("base")
    file = base_of(raw, path)
    assert file is not None
    require(file.resolve() not in [each.resolve() for each in (*above, path)], "base", base,
            "another file: this one has itself as its base")
    below = with_base(read_yaml(file), file, (*above, path))
    inherited = {key: value for key, value in below.items() if key not in ("name", "description")
                 } if isinstance(below, dict) else {}
    if isinstance(own.get("modules"), list):  # Those of the base are needed, too.
        own["modules"] = list(dict.fromkeys([*inherited.get("modules", []), *own["modules"]]))
    return _merged(inherited, own)


def base_of(raw: object, path: Path) -> Path | None:
    """Returns the file of the `base` of a file's raw data; None without one."""
    if not isinstance(raw, dict) or "base" not in raw:
        return None
    base = raw["base"]
    require(isinstance(base, str), "base", base, "a shipped scenario's name, or a YAML file")
    folder = path.parent / base
    named = base in shipped_scenarios() or (not Path(base).suffix and not folder.exists())
    return scenario_path(base if named else str(folder), "base")


def not_inherited(file: str) -> dict[str, list[str]]:
    """Returns the keys of a file's bases that a tag of the file keeps from being inherited.

    A mapping is merged with its base's, one with a tag replaces it: its other keys have defaults.

    Args:
        file: Name of a shipped scenario, or a path.

    Returns:
        By the dotted key of each such mapping, the keys below it with the base's values.
    """
    path = scenario_path(file)
    raw = read_yaml(path)
    if not isinstance(raw, dict) or "base" not in raw:
        return {}
    own = {key: value for key, value in raw.items() if key != "base"}
    return dict(_replaced_by_tags(with_base({"base": raw["base"]}, path, ()), own))


def _replaced_by_tags(base: object, own: object, key: str = ""
                      ) -> Iterator[tuple[str, list[str]]]:
    """Yields each mapping of `own` whose tag replaces one of `base`, with the lost leaves."""
    if not (isinstance(base, dict) and isinstance(own, dict)):
        return
    if "_tag" in own:
        mine = dict(leaves(own))
        yield key, [f"{name} = {value}" for name, value in leaves(base) if name not in mine]
        return
    for name, value in own.items():
        yield from _replaced_by_tags(base.get(name), value, f"{key}.{name}" if key else str(name))


def leaves(data: object, key: str = "") -> Iterator[tuple[str, str]]:
    """Yields dotted keys and values, as text, of raw data; a list without mappings is one value."""
    if isinstance(data, dict):
        for name, value in data.items():
            yield from leaves(value, f"{key}.{name}" if key else str(name))
    elif isinstance(data, list) and any(isinstance(item, dict) for item in data):
        for i, item in enumerate(data):
            yield from leaves(item, f"{key}.{i}" if key else str(i))
    else:
        yield key, "null" if data is None else str(data)


def _merged(base: object, own: object) -> object:
    """Returns `own` with the entries of `base` that it lacks; a tag replaces all."""
    if not (isinstance(base, dict) and isinstance(own, dict)) or "_tag" in own:
        return own
    return {**base, **{key: _merged(base.get(key), value) for key, value in own.items()}}


def apply_overrides(raw: object, overrides: Sequence[str]) -> object:
    """Returns raw data with `key.path=value` texts applied; values are not checked here."""
    for text in overrides:
        path, equals, value = text.partition("=")
        require(bool(equals and all(path.split("."))), "--set", text, "key.path=value")
        raw = _replaced(raw, path.split("."), _override_value(path, value))
    return raw


def _override_value(key: str, value: str) -> object:
    try:
        data = parse_yaml(f"v: {value}")
    except ScenarioError:
        data = None
    if not isinstance(data, dict) or list(data) != ["v"]:
        raise InvalidParameter(
            key, value, "a YAML value (in quotes, if it is text with : or brackets; a tag with {})")
    return data["v"]


def _replaced(raw: object, path: Sequence[str], value: object, key: str = "") -> object:
    """Returns `raw` with `value` at a path of keys and list indices below it."""
    if not path:
        return value
    head, rest = path[0], path[1:]
    key = f"{key}.{head}" if key else head
    if isinstance(raw, list):
        require(head.isdecimal() and int(head) < len(raw), key, value,
                f"given with an index below {len(raw)}")
        return [_replaced(item, rest, value, key) if i == int(head) else item
                for i, item in enumerate(raw)]
    mapping = raw if isinstance(raw, dict) else {}
    return {**mapping, head: _replaced(mapping.get(head), rest, value, key)}
