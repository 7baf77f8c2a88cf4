"""The tutorials: each runs without an error, contains its figures and keeps to the glossary."""

import base64
import json
import re
from pathlib import Path

import pytest
from support.pages import PACKAGE, ROOT, sections
from test_vocabulary import RETIRED

FOLDER = ROOT / "examples" / "tutorials"
TUTORIALS = sorted(FOLDER.glob("*.ipynb"))
LARGEST_FIGURE = 300_000  # Bytes.

LONG = ("4_own_robot", "5_certificate", "6_inspection", "7_real_loop", "8_from_logs")
"""Tutorials of some minutes of a core, which CI does not run."""

each = pytest.mark.parametrize("path", TUTORIALS, ids=lambda path: path.stem)


def cells(path: Path, kind: str) -> list[dict]:
    return [cell for cell in json.loads(path.read_text("utf-8"))["cells"]
            if cell["cell_type"] == kind]


@pytest.mark.parametrize("path", [
    pytest.param(path, marks=pytest.mark.long if path.stem in LONG else pytest.mark.slow)
    for path in TUTORIALS], ids=lambda path: path.stem)
def test_a_tutorial_runs(path, tmp_path):
    pytest.importorskip("nbclient", reason="needs pip install '.[tutorials]'")
    import nbformat
    from tutorials.execute import executed
    done = executed(path, tmp_path)
    nbformat.write(done, tmp_path / path.name)  # To look at its figures.
    assert any("image/png" in output.get("data", {})
               for cell in done.cells for output in cell.get("outputs", ()))


@each
def test_a_tutorial_is_committed_with_the_outputs_of_a_whole_run(path):
    code = cells(path, "code")
    assert [cell["execution_count"] for cell in code] == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell["outputs"]]
    assert not [output for output in outputs if output["output_type"] == "error"]
    assert not [output for output in outputs if output.get("name") == "stderr"]
    figures = [base64.b64decode("".join(output["data"]["image/png"]))
               for output in outputs if "image/png" in output.get("data", {})]
    assert figures
    assert max(map(len, figures)) <= LARGEST_FIGURE


@each
def test_a_tutorial_has_no_retired_word(path):
    for cell in cells(path, "markdown") + cells(path, "code"):
        text = "".join(cell["source"]).lower()
        words = set(re.findall(r"[a-z]+", re.sub(r"\(\S+?\)|`[^`]*`", " ", text)))
        assert not words & RETIRED.keys(), text


@each
def test_a_link_of_a_tutorial_leads_somewhere(path):
    text = "".join("".join(cell["source"]) for cell in cells(path, "markdown"))
    headings = sections(PACKAGE / "glossary.md")
    links = re.findall(r"\]\(([^)#]+)(?:#([^)]+))?\)", text)
    assert any(target.endswith("glossary.md") for target, _ in links)
    for target, anchor in links:
        assert (FOLDER / target).exists(), target
        assert not anchor or not target.endswith("glossary.md") or anchor in headings, anchor
