"""Version of the program, and the folder that contains its packages."""

from pathlib import Path

__version__ = "0.1.0"
ROOT = Path(__file__).parents[1]
