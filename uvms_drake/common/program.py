"""The program itself: its version, and the folder that it is installed in."""

from pathlib import Path

VERSION = "0.2.0"
FOLDER = Path(__file__).parent.parent
