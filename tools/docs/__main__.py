"""Build the documentation site into build/site: ``make docs``.

The script copies the pages of docs/. It replaces links to files outside docs/ by the names of these
files, and adds the navigation to the page of decisions. It generates the reference and runs every
script of examples/gallery. Warnings are errors.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tools.docs.c_reference import c_reference  # noqa: E402
from tools.docs.command_line import command_line  # noqa: E402
from tools.docs.pages import chapter_pages, decision_navigation, landing_page, without_outside_links  # noqa: E402
from tools.docs.python_names import python_names  # noqa: E402

SOURCE, SITE = ROOT / "build" / "site-source", ROOT / "build" / "site"


def assemble(target_folder: Path) -> None:
    """Write all inputs of Sphinx to one folder."""
    shutil.rmtree(target_folder, ignore_errors=True)
    (target_folder / "reference").mkdir(parents=True)
    shutil.copytree(ROOT / "docs" / "img", target_folder / "img")
    shutil.copytree(ROOT / "examples" / "gallery", target_folder / "gallery_scripts")
    (target_folder / "decisions").mkdir()
    for page in (ROOT / "docs").rglob("*.md"):
        name = page.relative_to(ROOT / "docs")
        text = without_outside_links(page.read_text(encoding="utf-8"), len(name.parts) - 1)
        (target_folder / name).write_text(text, encoding="utf-8")
    with (target_folder / "decisions" / "index.md").open("a", encoding="utf-8") as notes:
        notes.write(decision_navigation(ROOT / "docs" / "decisions"))
    pages = {
        "index": landing_page(),
        **chapter_pages(),
        "reference/python-names": python_names(),
        "reference/command-line": command_line(),
        "reference/c": c_reference(ROOT / "core" / "include"),
    }
    for name, text in pages.items():
        (target_folder / f"{name}.md").write_text(text, encoding="utf-8")
    shutil.copy(Path(__file__).with_name("conf.py"), target_folder / "conf.py")


def main() -> int:
    """Assemble and build the site; return the exit code of Sphinx."""
    assemble(SOURCE)
    command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html"]
    completed = subprocess.run([*command, str(SOURCE), str(SITE)], check=False)
    if completed.returncode == 0:
        print(f"docs: {SITE.relative_to(ROOT)}/index.html")
    return completed.returncode


if __name__ == "__main__":
    sys.exit(main())
