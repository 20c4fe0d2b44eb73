"""Where the C sources of the core and of the virtual plant stand."""

from __future__ import annotations

from pathlib import Path

from anhyst.support.errors import InputError


def core_folder() -> Path:
    """Return the folder with ``include/``, ``src/`` and ``port/`` of the core.

    In a source tree it is the one that is edited, otherwise the copy inside the package.
    """
    package = Path(__file__).resolve().parents[1]
    for place in (package.parents[1] / "core", package / "_core" / "c"):
        if (place / "include" / "anhyst" / "compensator" / "compensator.h").is_file():
            return place
    raise InputError(
        f"{package}: the C sources of the core are missing; install anhyst again",
        code="installation-incomplete",
    )


def plant_folder() -> Path:
    """Return the folder with ``include/`` and ``src/`` of the virtual plant; see :func:`core_folder`."""
    package = Path(__file__).resolve().parents[1]
    for place in (package.parents[1] / "plant", package / "_core" / "plant"):
        if (place / "include" / "anhyst_plant" / "body.h").is_file():
            return place
    raise InputError(
        f"{package}: the C sources of the plant are missing; install anhyst again",
        code="installation-incomplete",
    )
