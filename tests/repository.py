"""Where the repository is: tests of all parts read its examples, pages and sources."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
