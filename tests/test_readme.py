"""The READMEs: code runs, links lead somewhere, and numbers are settings or written by commands."""

import re
import subprocess
import sys

import numpy as np
import pytest
from support.pages import READMES, ROOT, sections

from uvms_drake.command.keys import keys_of
from uvms_drake.station.scenario.scenario import Scenario, load_scenario

CERTIFICATE = ROOT / "uvms_drake" / "certificate" / "README.md"


def test_the_loop_of_the_readme_runs_and_presses(tmp_path):
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL)
    assert code.count("\n") <= 21
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True,
                          text=True, timeout=900, check=True)
    force = float(re.search(r"-?\d+\.\d+", done.stdout)[0])
    (promised,) = re.findall(r"# 𝔉 .*: (\d+\.\d+) N along x", code)
    assert force == pytest.approx(float(promised), abs=0.06)


def unstable_from() -> dict[str, tuple[float, float]]:
    """Returns lag and delay [s] of each scenario in the guide's table."""
    rows = re.findall(r"^\| `(\w+)` \| (\d\.\d+) \| (\d\.\d+) \|$", CERTIFICATE.read_text("utf-8"),
                      re.MULTILINE)
    assert [name for name, *_ in rows] == ["girona500_ideal", "girona500_contact"]
    return {name: (float(lag), float(delay)) for name, lag, delay in rows}


def test_the_lags_that_the_guide_of_the_certificate_names_are_where_the_loop_becomes_unstable():
    """Of ë + (k + σ) ė + kσ e = 0 through a lag T: T s³ + s² + (k + σ) s + kσ."""
    for name, (T, _) in unstable_from().items():
        law = load_scenario(name).ancillary
        for lag, stable in ((0.99 * T, True), (1.01 * T, False)):
            roots = np.roots([lag, 1.0, law.k + law.sigma, law.k * law.sigma])
            assert (np.max(roots.real) < 0.0) == stable


def test_the_delays_that_the_guide_of_the_certificate_names_are_where_the_loop_becomes_unstable():
    """The same through a delay: where ((k + σ) s + kσ)/s² has the size 1, its phase is used up."""
    for name, (_, delay) in unstable_from().items():
        law = load_scenario(name).ancillary
        total, product = law.k + law.sigma, law.k * law.sigma
        crossing = np.sqrt(0.5 * (total**2 + np.sqrt(total**4 + 4.0 * product**2)))
        most = np.arctan2(total * crossing, product) / crossing
        assert 0.9 * most < delay <= most


@pytest.mark.parametrize("path", READMES, ids=lambda path: str(path.relative_to(ROOT)))
def test_what_a_readme_links_to_is_there(path):
    for target in re.findall(r"\]\(([^)]+)\)", path.read_text(encoding="utf-8")):
        if target.startswith("https://"):
            continue
        file, _, anchor = target.partition("#")
        page = path.parent / file if file else path
        assert page.exists(), target
        text = page / "README.md" if page.is_dir() else page
        assert not anchor or anchor in sections(text), target


def test_every_file_of_the_map_is_there():
    package = ROOT / "uvms_drake"
    text = (package / "README.md").read_text("utf-8")
    named = set(re.findall(r"(?<![\w/])((?:\w+/)*\w+\.py)\b", text)) - {"tests/test_imports.py"}
    files = {str(path.relative_to(package)) for path in package.rglob("*.py")}
    assert len(named) > 30
    assert [name for name in sorted(named)
            if name not in files and not any(f.endswith(f"/{name}") for f in files)] == []


def test_a_readme_is_a_guide_of_at_most_120_lines():
    assert [path for path in READMES if path.read_text("utf-8").count("\n") > 120] == []


def test_the_guides_are_short_and_their_lines_too():
    """All together at most 11,000 words, as `wc -w` counts; lines of at most 160 characters."""
    texts = {path: path.read_text("utf-8") for path in READMES}
    assert sum(len(text.split()) for path, text in texts.items() if path.parent != ROOT) <= 11_000
    assert [f"{path}: {line}" for path, text in texts.items() for line in text.splitlines()
            if len(line) > 160] == []


UNITS = r"N/m|N m|kN/m|m/s²|m/s|rad/s|mrad|mm|ms|Hz|kg|N|m|s|%|°|times"
NUMBER = r"(?<![\w.,/^])(\d+(?:\.\d+)?)"
MEASURE = re.compile(rf"{NUMBER}\s?(?:{UNITS})(?![\w/²])")


def prose(text: str) -> str:
    """Returns a page without code, formulas, links' targets, and rows of tables of settings."""
    text = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    return re.sub(r"`[^`]*`|\]\([^)]*\)|\$[^$]*\$", " ", text)


def values_of_files() -> set[float]:
    """Returns all numbers of the shipped files, of the defaults of keys and of results' pages."""
    texts = [path.read_text(encoding="utf-8") for pattern in (
        "uvms_drake/scenarios/*.yaml", "models/*/*.yaml", "examples/results/*.md",
        "examples/comparison/*.md") for path in ROOT.glob(pattern)]
    texts += [line for _, line in keys_of(Scenario())]
    return {float(number) for text in texts for number in re.findall(r"\d+(?:\.\d+)?", text)}


FILES = values_of_files()


@pytest.mark.parametrize("path", READMES, ids=lambda path: str(path.relative_to(ROOT)))
def test_a_number_in_prose_is_a_setting_or_is_written_by_a_command(path):
    text = prose(path.read_text(encoding="utf-8"))
    unknown = [match[0] for match in MEASURE.finditer(text) if float(match[1]) not in FILES]
    assert unknown == []
