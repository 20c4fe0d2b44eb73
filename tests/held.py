"""Skip tests that passed before with the same sources, according to a record.

Some tests depend only on C sources: claims under sanitizers, seeded faults, builds for other
systems. Such a test is marked ``depends`` with the files and folders that it uses. With
ANHYST_HELD=record (`make held`, `make test-all`) all tests run, and each marked test that passes is
recorded in tests/held.toml with a hash over its files. With ANHYST_HELD=1 (.ci/run) a test is
skipped if its hash equals the recorded one. Otherwise all tests run.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
import shutil
import subprocess
import tomllib
from collections.abc import Generator, Iterable
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
RECORD = Path(os.environ.get("ANHYST_HELD_RECORD", ROOT / "tests" / "held.toml"))
HEAD = """\
# Tests marked `depends` that passed; written by `make held` and `make test-all`, not by hand. The
# hash is over all that a test depends on: where that has changed, .ci/run runs it again.
"""
REASON = "it passed with the same sources, as recorded in tests/held.toml"

EVERY = ("pyproject.toml", "conftest.py", "tests/held.py", "tests/once.py")
"""Files that every test depends on: how tests are run, and the helpers that they share."""

TOOLS = ("cc", "clang", "ld", "qemu-aarch64")
PACKAGES = ("cmake", "ninja", "ziglang")

HASH = pytest.StashKey[str]()


@cache
def surroundings() -> list[str]:
    """Return versions of the tools that build and run C here, and features of the processor."""
    from anhyst._core import _native

    said = [f"{name} {importlib.metadata.version(name)}" for name in PACKAGES]
    for name in TOOLS:
        command = [shutil.which(name) or "false", "--version"]
        said.append(subprocess.run(command, capture_output=True, text=True, check=False).stdout)
    return [*said, os.uname().machine, *_native.batch_levels()]


def content_hash(paths: Iterable[str], root: Path = ROOT) -> str:
    """Return a hash over files and folders, and over the build tools of this machine."""
    digest = hashlib.sha256(json.dumps(surroundings()).encode())
    for path in sorted({*paths, *EVERY}):
        hashed_paths = [root / path]
        if (root / path).is_dir():  # a README does not affect a test
            hashed_paths = [one for one in sorted((root / path).rglob("*")) if one.suffix != ".md"]
        for file in hashed_paths:
            if file.is_file() and "__pycache__" not in file.parts:
                content = file.read_bytes()
                digest.update(f"{file.relative_to(root)}\0{len(content)}\0".encode() + content)
    return digest.hexdigest()


def hash_of(item: pytest.Item) -> str:
    """Return the hash over the files that a marked test names, and over the test's file."""
    named_paths = {path for mark in item.iter_markers("depends") for path in mark.args}
    return content_hash({*named_paths, str(item.path.relative_to(ROOT))})


class Held:
    """Plugin that skips recorded tests and reports passed ones; one process writes the record."""

    def __init__(self, *, recording: bool) -> None:
        self.recording = recording
        self.before: dict[str, str] = {}
        if RECORD.is_file():
            self.before = tomllib.loads(RECORD.read_text(encoding="utf-8"))
        self.passed: dict[str, str] = {}
        self.failed: set[str] = set()

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        for item in items:
            if item.get_closest_marker("depends"):
                item.stash[HASH] = hash_of(item)
                if not self.recording and self.before.get(item.nodeid) == item.stash[HASH]:
                    item.add_marker(pytest.mark.skip(reason=REASON))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        has_passed = report.when == "call" and report.passed
        if self.recording and HASH in item.stash and has_passed and self.is_unmoved(item):
            report.user_properties.append(("held", item.stash[HASH]))
        return report

    @staticmethod
    def is_unmoved(item: pytest.Item) -> bool:
        """Whether the files that a test depends on did not change while it ran."""
        return hash_of(item) == item.stash[HASH]

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.failed.add(report.nodeid)
        for name, value in report.user_properties:
            if name == "held":
                self.passed[report.nodeid] = str(value)

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self.recording and self.passed and not hasattr(session.config, "workerinput"):
            now = self.before | self.passed
            lines = [
                f"{json.dumps(name)} = {json.dumps(now[name])}\n" for name in sorted(now.keys() - self.failed)
            ]
            whole = RECORD.with_suffix(".part")
            whole.write_text(HEAD + "".join(lines), encoding="utf-8")
            whole.replace(RECORD)
