"""A release: one version, known to the citation and the changelog, and packages that PyPI takes."""

import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile

import pytest
from support.pages import ROOT

from uvms_drake.common.program import VERSION


def test_the_version_is_in_one_place_and_what_repeats_it_agrees():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    assert project["project"]["dynamic"] == ["version"]
    assert project["tool"]["setuptools"]["dynamic"]["version"] == {
        "attr": "uvms_drake.common.program.VERSION"}
    cited = re.findall(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text("utf-8"), re.M)
    assert cited == [VERSION]
    assert f"\n## {VERSION}\n" in (ROOT / "CHANGELOG.md").read_text("utf-8")


@pytest.mark.slow
def test_wheel_and_sdist_are_built_and_pass_the_check_of_pypi(tmp_path):
    for name in ("build", "twine"):
        pytest.importorskip(name, reason="needs pip install build twine")
    pytest.importorskip("setuptools", "77", reason="needs what pyproject.toml asks to build with")
    subprocess.run([sys.executable, "-m", "build", "--no-isolation", "--outdir", str(tmp_path),
                    str(ROOT)], check=True, capture_output=True, timeout=600)
    wheel, sdist = (next(tmp_path.glob(f"uvms_drake-{VERSION}{end}")) for end in (
        "-py3-none-any.whl", ".tar.gz"))
    subprocess.run([sys.executable, "-m", "twine", "check", "--strict", str(wheel), str(sdist)],
                   check=True, capture_output=True, timeout=120)
    names = set(zipfile.ZipFile(wheel).namelist())
    with tarfile.open(sdist) as file:
        packed = {name.partition("/")[2] for name in file.getnames()}
    for needed in ("uvms_drake/scenarios/girona500_contact.yaml", "uvms_drake/report/page.html",
                   "uvms_drake/models/girona500_arm5e/girona500_arm5e.sdf"):
        assert needed in names
        assert needed in packed or needed.removeprefix("uvms_drake/") in packed
