"""Hooks of MkDocs: pages of the documentation at their own places, nothing is copied.

The pages are all that `README.md` leads to: Markdown as it is; a notebook with its outputs; a
folder without a README as a list of its files; any other text as a listing. Links between them are
those of the repository. Besides there are a gallery of the scenarios, drawn when the site is built,
and the API of every room, from annotations and docstrings. Formulas become MathML, which browsers
show without a script.
"""

import io
import json
import re
from pathlib import Path

import latex2mathml.converter
import numpy as np
from matplotlib.image import imsave
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

import uvms_drake as uv
from uvms_drake.control.laws.law import AncillaryLaw  # noqa: F401  (loads the kinds that YAML names)
from uvms_drake.model.surface.law import check_surface
from uvms_drake.report.robot.render import RobotScene, picture_axes
from uvms_drake.report.robot.robot_figure import EYE, SIZE, SQUARES, wall_triangles
from uvms_drake.station.problem import surface_heading, true_surface
from uvms_drake.station.scenario.scenario_file import shipped_scenarios

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "uvms_drake"
PICTURES = (".png", ".gif")
LINK = re.compile(r"(\]\()([^)\s]+)(\))")
CODE = re.compile(r"(```.*?\n```|`[^`\n]+`)", re.DOTALL)
LANGUAGES = {".py": "python", ".yaml": "yaml", ".toml": "toml", ".csv": "text"}
UNSEARCHED = "---\nsearch:\n  exclude: true\n---\n"
"""Head of a listing: search finds the guides and the API."""
WIDTH = 640
"""Width of a picture in the gallery [pixels]."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages of the repository, the gallery and the API."""
    pages, assets = collected()
    pages["scenarios.md"], drawn = gallery()
    rooms = sorted(path for path in PACKAGE.iterdir() if list(path.glob("**/*.py")))
    pages["api/index.md"] = public_names()
    for room in rooms:
        pages[f"api/{room.name}.md"] = api_of(room)
    for uri, text in pages.items():
        files.append(File.generated(config, uri, content=text))
    for uri, path in assets.items():
        files.append(File.generated(config, uri, abs_src_path=str(path)))
    for uri, png in drawn.items():
        files.append(File.generated(config, uri, content=png))
    tutorials = sorted(uri for uri in pages if re.fullmatch(r"examples/tutorials/\d.*\.md", uri))
    results = sorted(uri for uri in pages if re.fullmatch(r"examples/results/[a-z_]+\.md", uri))
    theory = sorted(uri for uri in pages if uri.endswith("theory.md"))
    for entry in config.nav:
        for title, also in (("Tutorials", tutorials), ("Results", results)):
            if title in entry:
                entry[title] = [entry[title], *also]
    config.nav += [{"Theory": theory},
                   {"API": ["api/index.md", *({room.name: f"api/{room.name}.md"}
                                              for room in rooms)]}]
    return files


def on_page_content(html: str, **_: object) -> str:
    """Returns the page with its formulas as MathML."""
    def formula(match: re.Match) -> str:
        tag, latex = match[1], match[2].strip()[2:-2]
        return f'<{tag} class="arithmatex">{mathml(latex, tag == "div")}</{tag}>'

    return re.sub(r'<(span|div) class="arithmatex">(.*?)</\1>', formula, html, flags=re.DOTALL)


def mathml(latex: str, is_block: bool) -> str:
    """Returns a formula as MathML."""
    plain = latex.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")
    plain = re.sub(r"\\tag\{(.*?)\}", r"\\qquad (\1)", plain).replace(r"\thinspace", r"\,")
    return latex2mathml.converter.convert(plain, display="block" if is_block else "inline")


# Pages of the repository --------------------------------------------------------------------------


def collected() -> tuple[dict[str, str], dict[str, Path]]:
    """Returns pages and files, by their paths in the site, that README.md leads to."""
    pages: dict[str, str] = {}
    assets: dict[str, Path] = {}
    todo = [ROOT / "README.md"]
    while todo:
        path = todo.pop()
        uri = uri_of(path)
        if uri in pages or uri in assets:
            continue
        if path.suffix in PICTURES:
            assets[uri] = path
            continue
        pages[uri], linked = with_links(text_of(path), path, uri)
        todo += linked
    return pages, assets


def uri_of(path: Path) -> str:
    """Returns the place of a file or folder in the site."""
    relative = path.resolve().relative_to(ROOT)
    if path.is_dir():
        return str(relative / "README.md")
    if path.suffix in (".md", *PICTURES):
        return str(relative)
    return str(relative.with_suffix(".md") if path.suffix == ".ipynb" else f"{relative}.md")


def text_of(path: Path) -> str:
    """Returns the Markdown of a file or folder."""
    if path.is_dir():
        page = path / "README.md"
        return page.read_text("utf-8") if page.is_file() else listing(path)
    if path.suffix == ".ipynb":
        return notebook(path)
    text = path.read_text("utf-8")
    if path.suffix == ".md":  # A list needs a blank line before it here.
        return re.sub(r"(?m)^(?![-*|>#\s])(.+)\n(?=(?:[-*]|1\.) )", r"\1\n\n", text)
    language = LANGUAGES.get(path.suffix, "text")
    return (f"{UNSEARCHED}# {path.name}\n\n`{path.relative_to(ROOT)}`\n\n"
            f"````{language}\n{text}\n````\n")


def listing(folder: Path) -> str:
    """Returns the list of a folder's files, with the first line of each docstring."""
    rows = []
    for path in sorted(folder.iterdir()):
        if path.name.startswith(("_", ".")) or not (path.is_dir() or path.suffix in (
                ".py", ".md", ".yaml")):
            continue
        said = re.match(r'"""(.*?)(?:"""|\n)', path.read_text("utf-8")) if path.suffix == ".py" \
            else None
        rows.append(f"| [{path.name}]({path.name}) | {said[1] if said else ''} |")
    return f"# {folder.relative_to(ROOT)}\n\n| | |\n|---|---|\n" + "\n".join(rows) + "\n"


def with_links(text: str, path: Path, uri: str) -> tuple[str, list[Path]]:
    """Returns a page whose links lead to pages of the site, and the files that it links to."""
    folder, linked = path if path.is_dir() else path.parent, []

    def target(match: re.Match) -> str:
        file, _, anchor = match[2].partition("#")
        if re.match(r"\w+:", file) or not file:
            return match[0]
        found = (folder / file).resolve()
        if not found.exists():
            return match[0]
        linked.append(found)
        up = "../" * uri.count("/")
        return f"{match[1]}{up}{uri_of(found)}{'#' + anchor if anchor else ''}{match[3]}"

    parts = CODE.split(text)
    parts[::2] = [LINK.sub(target, part) for part in parts[::2]]
    return "".join(parts), linked


def notebook(path: Path) -> str:
    """Returns a notebook with its outputs as Markdown."""
    parts = []
    for cell in json.loads(path.read_text("utf-8"))["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        for output in cell["outputs"]:
            data = output.get("data", {})
            if "image/png" in data:
                png = "".join("".join(data["image/png"]).split())
                parts.append(f'<img alt="output" src="data:image/png;base64,{png}">')
            elif "text" in output or "text/plain" in data:
                text = "".join(output.get("text") or data["text/plain"]).rstrip()
                parts.append(f"````text\n{text}\n````")
    return "\n\n".join(parts) + "\n"


# Generated pages ----------------------------------------------------------------------------------


def gallery() -> tuple[str, dict[str, bytes]]:
    """Returns the page of all shipped scenarios, and the picture of the start of each."""
    parts, drawn = ["# All scenarios\n\nEach at its start, with its surface; [what each assumes]"
                    "(uvms_drake/scenarios/README.md)."], {}
    for name in shipped_scenarios():
        scenario = uv.load_scenario(name)
        drawn[f"scenarios/{name}.png"] = picture_of(scenario)
        parts += [f"## {name}", f"![{name}](scenarios/{name}.png){{ width={WIDTH // 2} }}",
                  " ".join(scenario.description.split()),
                  f"`uvms-drake run {name}` · robot `{scenario.model}` · {scenario.duration:g} s"]
    return "\n\n".join(parts) + "\n", drawn


def picture_of(scenario: uv.Scenario) -> bytes:
    """Returns the robot at the start of a scenario, with its surface, as PNG."""
    config = np.concatenate([scenario.start.eta, scenario.start.q])
    heading = surface_heading(scenario)
    turn = np.array([[np.cos(heading), -np.sin(heading), 0.0],
                     [np.sin(heading), np.cos(heading), 0.0], [0.0, 0.0, 1.0]])
    surface, pose = check_surface(true_surface(scenario)), scenario.task.pose
    place = surface.anchor if pose is None else np.asarray(pose, dtype=float)[:3]
    wall = surface.patch(place, SIZE, SQUARES + 1)
    scene = RobotScene(scenario.model, config, [] if wall is None else wall_triangles(wall))
    R = picture_axes(turn @ EYE)
    seen = [scene.corners, *([] if wall is None else [wall.reshape(-1, 3)])]
    corners = np.concatenate(seen) @ R[:2].T
    picture = scene.picture(R, corners.min(axis=0) - 0.1, corners.max(axis=0) + 0.1, WIDTH)
    png = io.BytesIO()
    imsave(png, np.asarray(picture)[::-1], format="png")
    return png.getvalue()


def public_names() -> str:
    """Returns the page of the names that `import uvms_drake as uv` offers."""
    rows = []
    for name in uv.__all__:
        value = getattr(uv, name)
        said = (value.__doc__ or "").strip().splitlines()[:1]
        module = getattr(value, "__module__", None)
        link = f"[`uv.{name}`][{module}.{value.__name__}]" if module else f"`uv.{name}`"
        rows.append(f"| {link} | {said[0].replace('|', chr(92) + '|') if said else ''} |")
    return ("# Names of `import uvms_drake as uv`\n\nSI units, radians; shapes and units stand "
            "at each attribute and argument.\n\n| name | |\n|---|---|\n"
            + "\n".join(rows) + "\n")


def api_of(room: Path) -> str:
    """Returns the page of a room's modules."""
    modules = [".".join(path.relative_to(ROOT).with_suffix("").parts)
               for path in sorted(room.rglob("*.py")) if path.name != "__init__.py"]
    return f"# {room.name}\n\n" + "\n\n".join(f"::: {module}" for module in modules) + "\n"
