"""Where the C of a bundle is put together with the harness and compiled for a target."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

from anhyst.compilation.toolchain import PIDD2, SRC, Build, core_files
from anhyst.link.firmware import actuator_defines, firmware_folder
from anhyst.verification.bundle import FORMATS, PLAY, Bundle
from anhyst.verification.elf import Image
from anhyst.verification.protocol import RecordForm, Reply, Request, stage_form

HARNESS = Path(__file__).resolve().parent / "harness"
WITHOUT_LIBRARY = "msp430"
"""The port for which the compiler brings no run-time routines."""

FREE_OF_LIBRARIES = "freestanding"
"""Folder of headers that a library would bring."""

Subject = Literal["compensator", "controller", "stage"]

SECTIONS_APART = ("-ffunction-sections", "-fdata-sections")
ONE_ROUNDING_EACH = "-ffp-contract=off"
"""A product and a sum are rounded each: otherwise two targets cannot have the same bits."""

ROOT_IS_AN_INSTRUCTION = "-fno-math-errno"
"""Where a processor has one; nobody here looks at ``errno``."""


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
    subject: Subject = "compensator"  # what of it is run

    @classmethod
    def set_up(cls, bundle: Bundle, folder: Path, subject: Subject = "compensator") -> Workshop:
        """Copy the C of the bundle and the harness into a scratch folder."""
        sources = folder / "c"
        sources.mkdir(parents=True)
        bundle.copy_sources(sources)
        for source in HARNESS.iterdir():
            folder_of = sources / FREE_OF_LIBRARIES if source.name == "math.h" else sources
            folder_of.mkdir(exist_ok=True)
            shutil.copyfile(source, folder_of / source.name)
        for name, text in core_files(PIDD2).items():
            path = sources / name
            if not path.exists():
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text, encoding="utf-8", newline="\n")
        return cls(bundle, folder, subject)

    def build(self, port: str, *flags: str) -> Build:
        """Return what to compile for a port of the harness, such as ``cortex_m``."""
        target = self.folder / "c"
        ports = [port, "freestanding"] if port == WITHOUT_LIBRARY else [port]
        sources = [name for name in self.bundle.c_files if name.endswith(".c")]
        if self.subject == "compensator":
            sources = [name for name in sources if name != f"{self.bundle.name}_controller.c"]
        free = [target / FREE_OF_LIBRARIES] if port == "cortex_m" else []
        names = [
            "harness.c",
            f"run_{self.subject}.c",
            *(f"{name}.c" for name in ports),
            *sorted({*sources, *CONTROL_SOURCES}),
        ]
        return Build(
            tuple(target / name for name in names),
            (target, target / "include", target / "port", firmware_folder(), *free),
            self._defines(),
            (*SECTIONS_APART, ONE_ROUNDING_EACH, ROOT_IS_AN_INSTRUCTION, *flags),
            ("-lm",) if port == "host" and self.subject == "stage" else (),
        )

    @property
    def form(self) -> RecordForm | None:
        """Form of the records of a stage."""
        stage = self.bundle.stage
        return stage_form(stage["free"], stage["heads"], stage["magnets"]) if stage else None

    def _defines(self) -> dict[str, str]:
        """Return the macros of the harness."""
        name = self.bundle.name
        if self.form is not None:
            return {
                "STAGE_HEADER": f'"{name}_controller.h"',
                "STAGE(part)": f"{name}_controller##part",
                "COUNT(part)": f"{name.upper()}_CONTROLLER_##part",
                "HARNESS_RECORD_WORDS": str(self.form.words),
                **({} if self.bundle.io == "f32" else {"STAGE_CODES": "1"}),
            }
        play = {"HARNESS_PLAY": "1"} if self.bundle.kind == PLAY else {}
        return {"HARNESS_IO": FORMATS[self.bundle.io], **play, **actuator_defines(name)}


CONTROL_SOURCES = tuple(f"{SRC}/{name}" for name in PIDD2)
