"""List the pages of the site in their order."""

from __future__ import annotations

import re
from pathlib import Path

CHAPTERS: dict[str, tuple[str, ...]] = {
    "Start": (
        "install",
        "tutorial",
        "commands",
        "coming-from",
        "howto-levitate",
        "init",
        "measurements",
        "file-formats",
        "identification",
        "flux",
        "rate",
        "choosing",
        "python",
    ),
    "Use a model": (
        "compile",
        "start-up",
        "verify",
        "proofs",
        "reliability",
        "force-control",
        "fleet",
        "exchange",
    ),
    "Rigs": (
        "simulate",
        "bearing",
        "tracking",
        "calibration",
        "planar",
        "actuators",
        "tune",
        "monte-carlo",
        "benefit",
        "rig-file",
        "controller-file",
    ),
    "While it runs": ("live", "bench", "excite", "firmware", "link", "boards", "xcp"),
    "Results": (
        "how-it-compares",
        "results-models",
        "results-controller",
        "results-bearing",
        "results-tracking",
    ),
    "Background": ("theory", "reproducibility", "faq", "contributing", "decisions/index"),
}
"""Hand-written pages of docs/ by chapter. The gallery and the reference follow them."""

REFERENCE = ("python-names", "command-line", "c")


def landing_page() -> str:
    """Return the landing page: a picture, a command and the chapters."""
    parts = [
        "# anhyst\n",
        "*From a measured loop to a linear actuator: the force follows the command without hysteresis.*\n",
        "The force of an electromagnet depends on the history of its current. anhyst fits a hysteresis "
        "model to force-current loops at a few air gaps, inverts the model, and compiles the inverse into "
        "fixed-point C. This C is proved to be free of overflow and verified bit for bit.\n",
        "```sh\nmake demo\n```\n",
        "![Measured and modelled loops of the bundled example](img/loops.png)\n",
        _table_of_contents((*map(chapter_file_name, CHAPTERS), "gallery/index", "reference"), depth=2),
    ]
    return "\n".join(parts)


def chapter_pages() -> dict[str, str]:
    """Return one page for each chapter, by name. It lists the pages of the chapter."""
    pages_by_name = {
        chapter_file_name(title): f"# {title}\n\n{_table_of_contents(pages)}"
        for title, pages in CHAPTERS.items()
    }
    pages = tuple(f"reference/{name}" for name in REFERENCE)
    return pages_by_name | {"reference": f"# Reference\n\n{_table_of_contents(pages)}"}


def without_outside_links(text: str, depth: int) -> str:
    """Return a page with links to files outside docs/ replaced by the names of these files.

    ``depth`` is the number of folders between docs/ and the page.
    """
    parent_prefix = r"\.\./" * (depth + 1)
    return re.sub(rf"\[([^\]]+)\]\({parent_prefix}([^)#]+)[^)]*\)", r"\1 (`\2`)", text)


def decision_navigation(folder: Path) -> str:
    """Return the navigation to the notes of a folder, sorted by their numbers."""
    notes = sorted(note.stem for note in folder.glob("[0-9]*.md"))
    return f"\n{_table_of_contents(tuple(notes)).replace(':maxdepth: 1', ':hidden:')}"


def chapter_file_name(title: str) -> str:
    """Return the name of a chapter's page. No page in docs/ has such a name."""
    return "chapter-" + title.lower().replace(" ", "-")


def _table_of_contents(pages: tuple[str, ...], depth: int = 1) -> str:
    lines = "\n".join(pages)
    return f"```{{toctree}}\n:maxdepth: {depth}\n\n{lines}\n```\n"
