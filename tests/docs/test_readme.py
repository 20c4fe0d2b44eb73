"""What the README shows is what the program does."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def block(heading: str) -> str:
    """First indented block under a heading."""
    part = TEXT.split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    lines = [line[4:] for line in part.splitlines() if line.startswith("    ") or not line]
    return "\n".join(lines).strip()


def test_python_of_the_readme_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    code = block("Python").replace('"examples/', f'"{ROOT}/examples/')
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(code, "README.md", "exec"), names)
    force, current = names["force"], names["current"]
    assert max(force) > 150.0  # type: ignore[call-overload]
    assert 0.5 < max(current) < 3.0  # type: ignore[call-overload]
    assert (tmp_path / "model.toml").is_file()


def test_python_of_the_page_about_python_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    page = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
    code = "\n".join(line[4:] for line in page.splitlines() if line.startswith("    "))
    monkeypatch.chdir(ROOT)
    exec(compile(code, "python.md", "exec"), {})


def test_options_of_the_readme_exist() -> None:
    shown: dict[str, set[str]] = {}
    for line in block("Command line").splitlines():
        verb, rest = re.split(r"\s+", line.split("anhyst ", 1)[1], maxsplit=1)
        shown.setdefault(verb, set()).update(re.findall(r"--[a-z-]+", rest.split("#")[0]))
    assert set(shown) == {
        "inspect",
        "convert",
        "identify",
        "init",
        "predict",
        "invert",
        "report",
        "diff",
        "compile",
        "verify",
        "force-control",
        "simulate",
        "tune",
        "live",
        "excite",
        "watch",
        "fleet",
        "export",
        "xcp",
    }
    for verb, options in shown.items():
        found = subprocess.run(
            [sys.executable, "-m", "anhyst.cli.app", verb, "--help"],
            capture_output=True,
            text=True,
            check=True,
            env={"COLUMNS": "200", "PATH": ""},
        )
        assert options <= set(re.findall(r"--[a-z-]+", found.stdout)), verb


@pytest.mark.parametrize(
    "page", ["README.md", "ARCHITECTURE.md", *sorted((ROOT / "docs").glob("*.md"))]
)
def test_links_between_pages_lead_somewhere(page: Path | str) -> None:
    path = ROOT / page
    for target in re.findall(r"\]\(([^)#]+)", path.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (path.parent / target).exists(), f"{page}: {target}"
