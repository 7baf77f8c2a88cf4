"""Pages of the repository, their headings, and the links that lead to them."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]  # Of the sources: the tested package is installed.
PACKAGE = ROOT / "uvms_drake"
READMES = sorted(path for path in ROOT.rglob("README.md")
                 if not any(part.startswith(".") or part in ("build", "out")
                            for part in path.relative_to(ROOT).parts))


def sections(page: Path, level: str = "#+") -> dict[str, str]:
    """Returns the text below each heading of a page, by the anchor that forges give to it."""
    parts = re.split(rf"^{level} (.+)$", page.read_text("utf-8"), flags=re.MULTILINE)[1:]
    anchors = (re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")
               for heading in parts[::2])
    return dict(zip(anchors, parts[1::2], strict=True))
