"""The README and the rooms' own: what they show runs, what they link to is there."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
READMES = sorted(path for path in ROOT.rglob("README.md")
                 if not any(part.startswith(".") or part in ("build", "out")
                            for part in path.relative_to(ROOT).parts))


def test_the_loop_of_the_readme_runs_and_presses(tmp_path):
    (code,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL)
    assert code.count("\n") <= 21
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True,
                          text=True, timeout=120, check=True)
    force = float(re.search(r"-?\d+\.\d+", done.stdout)[0])
    (promised,) = re.findall(r"# 𝔉 .*: (\d+\.\d+) N along x", code)
    assert force == pytest.approx(float(promised), abs=0.06)


def test_the_readme_is_short():
    assert (ROOT / "README.md").stat().st_size <= 12_000


def test_the_lags_that_the_readme_names_are_where_the_loop_becomes_unstable():
    """Of ë + (k + σ) ė + kσ e = 0 through a lag T: T s³ + s² + (k + σ) s + kσ, with k = 20 1/s."""
    text = (ROOT / "README.md").read_text("utf-8")
    found = re.findall(r"up to\s+(\d+\.\d+) s with σ = (\d+)", text)
    assert len(found) == 2
    for T, sigma in ((float(T), float(sigma)) for T, sigma in found):
        for lag, stable in ((0.99 * T, True), (1.01 * T, False)):
            roots = np.roots([lag, 1.0, 20.0 + sigma, 20.0 * sigma])
            assert (np.max(roots.real) < 0.0) == stable


@pytest.mark.parametrize("path", READMES, ids=lambda path: str(path.relative_to(ROOT)))
def test_what_a_readme_links_to_is_there(path):
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", path.read_text(encoding="utf-8")):
        assert target.startswith("https://") or (path.parent / target).exists(), target
