"""Executes the tutorials and writes them back with their outputs.

All of them, or those that are named: `python examples/tutorials/execute.py 1_plant`. Each runs in a
folder of its own, which is removed afterwards. Needs `pip install '.[tutorials]'`.
"""

import argparse
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).resolve().parent
TUTORIALS = sorted(FOLDER.glob("[0-9]_*.ipynb"))
CELL_SECONDS = 600
"""Wall time after which a cell counts as stuck [s]."""


def executed(path: Path, folder: Path) -> nbformat.NotebookNode:
    """Returns a notebook as run in a folder, with its outputs; raises the first error of a cell."""
    notebook = nbformat.read(path, as_version=4)
    client = NotebookClient(notebook, timeout=CELL_SECONDS, record_timing=False,
                            resources={"metadata": {"path": str(folder)}})
    client.execute()
    # The version of the Python that ran it would differ from commit to commit.
    notebook.metadata["language_info"] = {"name": "python"}
    return notebook


def main() -> None:
    """Executes and writes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", default=[p.stem for p in TUTORIALS],
                        choices=[path.stem for path in TUTORIALS], help="as 1_plant; default: all")
    for name in parser.parse_args().names:
        print(name, flush=True)
        with tempfile.TemporaryDirectory() as folder:
            notebook = executed(FOLDER / f"{name}.ipynb", Path(folder))
        nbformat.write(notebook, FOLDER / f"{name}.ipynb")


if __name__ == "__main__":
    main()
