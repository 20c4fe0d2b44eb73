"""Locate the repository, so that tests of all parts can read its examples, pages and sources."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
