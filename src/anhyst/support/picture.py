"""Figures as files: whole or not at all."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from anhyst.support.atomic import PathLike, check_writable, write_bytes
from anhyst.support.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def check_picture(path: PathLike) -> None:
    """Refuse a picture that could not be written in the end."""
    if Path(path).suffix.lower() not in {".png", ".svg", ".pdf"}:
        raise InputError(
            f"{path}: a plot is written as .png, .svg or .pdf; change the ending",
            code="wrong-ending",
        )
    check_writable(path)


def write_figure(figure: Figure, path: PathLike) -> None:
    """Write a figure in the format that the ending names."""
    picture = BytesIO()
    figure.savefig(picture, format=Path(path).suffix[1:].lower(), dpi=150)
    write_bytes(path, picture.getvalue())
