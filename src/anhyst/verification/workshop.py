"""Where the C of a bundle is put together with the harness and compiled for a target."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

from anhyst.compilation.core import PIDD2, SRC, core_files
from anhyst.compilation.toolchain import Build
from anhyst.link.firmware import actuator_defines, firmware_folder
from anhyst.verification.bundle import FORMATS, PLAY, Bundle
from anhyst.verification.elf import Image
from anhyst.verification.protocol import Reply, Request

HARNESS = Path(__file__).resolve().parent / "harness"
WITHOUT_LIBRARY = "msp430"
"""The port for which the compiler brings no run-time routines."""

Subject = Literal["compensator", "controller"]

SECTIONS_APART = ("-ffunction-sections", "-fdata-sections")
ONE_ROUNDING_EACH = "-ffp-contract=off"
"""A product and a sum are rounded each: otherwise two targets cannot have the same bits."""


class HarnessProgram(Protocol):
    """A linked harness that answers requests from reset."""

    def run(self, requests: Sequence[Request]) -> list[Reply]:
        """Answer one request after the other."""
        ...


@dataclass(frozen=True, slots=True)
class Variant:
    """One build of the C for one target."""

    target: str  # target, and what sets this build apart: ``gcc -O2``, ``portable``
    name: str
    program: HarnessProgram  # what to run
    unit: str  # what its clock counts: ``instructions``, ``cycles``, or nothing
    processor: str  # what it ran on and what made it, for the report
    compiler: str
    warnings: int  # the compiler's, of the bundle and the harness
    image: Image | None = None  # the linked program, where sizes can be read from it

    @property
    def label(self) -> str:
        """Target and build in one."""
        return f"{self.target} ({self.name})"


@dataclass(frozen=True, slots=True)
class Workshop:
    """A folder with copies of everything that is compiled."""

    bundle: Bundle  # what is verified
    folder: Path  # scratch folder; the C lies in ``c``, programs beside it
    subject: Subject = "compensator"  # what of it is run: ``compensator`` or ``controller``

    @classmethod
    def set_up(cls, bundle: Bundle, folder: Path, subject: Subject = "compensator") -> Workshop:
        """Copy the C of the bundle and the harness into a scratch folder."""
        place = folder / "c"
        place.mkdir(parents=True)
        bundle.copy_sources(place)
        for source in HARNESS.iterdir():
            shutil.copyfile(source, place / source.name)
        _add_control(place)
        return cls(bundle, folder, subject)

    def build(self, port: str, *flags: str) -> Build:
        """Return what to compile for a port of the harness, such as ``cortex_m``."""
        place = self.folder / "c"
        ports = [port, "freestanding"] if port == WITHOUT_LIBRARY else [port]
        sources = [name for name in self.bundle.c_files if name.endswith(".c")]
        if self.subject == "compensator":
            sources = [name for name in sources if name != f"{self.bundle.name}_controller.c"]
        names = [
            "harness.c",
            f"run_{self.subject}.c",
            *(f"{name}.c" for name in ports),
            *sorted({*sources, *CONTROL_SOURCES}),
        ]
        return Build(
            tuple(place / name for name in names),
            (place, place / "include", place / "port", firmware_folder()),
            self._defines(),
            (*SECTIONS_APART, ONE_ROUNDING_EACH, *flags),
        )

    def _defines(self) -> dict[str, str]:
        """Return the macros of the harness."""
        play = {"HARNESS_PLAY": "1"} if self.bundle.kind == PLAY else {}
        io = FORMATS[self.bundle.io]
        return {"HARNESS_IO": io, **play, **actuator_defines(self.bundle.name)}


CONTROL_SOURCES = tuple(f"{SRC}/{name}" for name in PIDD2)


def _add_control(place: Path) -> None:
    """Put the core's PIDD2, in fixed point, beside a bundle without one: a whole tick is measured."""
    for name, text in core_files(PIDD2).items():
        path = place / name
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8", newline="\n")
