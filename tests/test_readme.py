"""The README and the rooms' own: what they show runs, what they link to is there."""

import re
import subprocess
import sys
from pathlib import Path

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


@pytest.mark.parametrize("path", READMES, ids=lambda path: str(path.relative_to(ROOT)))
def test_what_a_readme_links_to_is_there(path):
    for target in re.findall(r"\]\(([^)#]+)(?:#[^)]*)?\)", path.read_text(encoding="utf-8")):
        assert target.startswith("https://") or (path.parent / target).exists(), target
