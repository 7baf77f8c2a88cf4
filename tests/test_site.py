"""The documentation as a site: it is built without a network, and each link and anchor resolves."""

import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from support.pages import ROOT

pytestmark = pytest.mark.slow


class Page(HTMLParser):
    """Targets of the links of a page, and its anchors."""

    def __init__(self, text: str):
        super().__init__()
        self.targets: list[str] = []
        self.anchors: set[str] = {""}
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        for key, value in attrs:
            if key in ("href", "src") and value:
                self.targets.append(value)
            if key in ("id", "name") and value:
                self.anchors.add(value)


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The built site; warnings, of links that lead nowhere, are errors."""
    for name in ("material", "mkdocstrings", "latex2mathml"):
        pytest.importorskip(name, reason="needs pip install '.[docs]'")
    folder = tmp_path_factory.mktemp("site")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "-f",
         str(ROOT / "examples/site/mkdocs.yml"), "-d", str(folder)],
        capture_output=True, text=True, check=False, timeout=600)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return folder


@pytest.fixture(scope="module")
def pages(site) -> dict[Path, Page]:
    return {path: Page(path.read_text("utf-8")) for path in site.rglob("*.html")}


def test_every_link_and_every_anchor_resolves(site, pages):
    broken = []
    for path, page in pages.items():
        if path.name == "404.html":  # Its links are from the root of a server.
            continue
        for target in page.targets:
            url = urlsplit(target)
            if url.scheme in ("https", "data", "mailto", "javascript"):
                continue
            file = (path.parent / unquote(url.path)).resolve() if url.path else path
            file = file / "index.html" if file.is_dir() else file
            anchor = unquote(url.fragment)
            if not file.is_file() or (anchor and anchor not in pages[file].anchors):
                broken.append(f"{path.relative_to(site)}: {target}")
    assert broken == []


def test_nothing_is_loaded_from_elsewhere(site):
    for path in site.rglob("*.html"):
        text = path.read_text("utf-8")
        assert not re.search(r"<(?:script|img|iframe)[^>]*\bsrc=\"https?:", text), path
        assert not re.search(r"<link[^>]*\brel=\"stylesheet\"[^>]*\bhref=\"https?:", text), path


def test_guides_tutorials_scenarios_signals_glossary_and_api_are_there(site, pages):
    for name in ("index", "uvms_drake/glossary", "uvms_drake/station/signals", "scenarios",
                 "uvms_drake/certificate/index", "examples/tutorials/1_plant", "api/control"):
        assert site / f"{name}.html" in pages, name
    gallery = (site / "scenarios.html").read_text("utf-8")
    shipped = sorted(path.stem for path in (ROOT / "uvms_drake/scenarios").glob("*.yaml"))
    assert re.findall(r'src="scenarios/(\w+)\.png"', gallery) == shipped
    assert all((site / f"scenarios/{name}.png").is_file() for name in shipped)
    assert "data:image/png" in (site / "examples/tutorials/1_plant.html").read_text("utf-8")
    assert "<math" in (site / "uvms_drake/tube/theory.html").read_text("utf-8")
    api = (site / "api/loop.html").read_text("utf-8")
    assert "uvms_drake.loop.controller.Controller.step" in api
