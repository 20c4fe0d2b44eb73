"""What may be said about an identification: by ``anhyst identify`` and by every rig file alike."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field

from anhyst.data.clean import STEPS
from anhyst.data.history import History
from anhyst.data.read_options import ReadOptions
from anhyst.model.schema import LawName
from anhyst.support.errors import InputError
from anhyst.support.toml_file import Table

GapMap = Literal["scaling", "reluctance", "circuit", "free", "auto"]
Search = Literal["default", "paper"]
Weights = Literal["loops", "points", "relative"]


def _readable(name: str) -> AfterValidator:
    """Check a text that says how measurements are read, as :class:`ReadOptions` does."""

    def check(text: str) -> str:
        try:
            options = ReadOptions.from_text(**{name: text})
            if options.history is not None:
                History.parse(options.history)
        except InputError as error:
            raise InputError(str(error).removeprefix(f"{name}: "), code=error.code) from error
        for step in options.clean:
            if step not in STEPS:
                raise InputError(
                    f"'{step}' is not known; there are: {', '.join(STEPS)}",
                    code="unknown-cleaning-step",
                )
        return text

    return AfterValidator(check)


class IdentifyTable(Table):
    """``[identify]``: the options of ``anhyst identify``, by the same names and in the same form.

    What is left out is as on the command line, but for the gap map: whoever identifies says which.
    """

    law: LawName | Literal["auto"] = "auto"
    gap_map: GapMap | None = None
    search: Search = "default"
    seed: Annotated[int, Field(ge=0)] = 1
    weights: Weights = "loops"
    offsets: bool = True
    dead_band: bool = True
    rate: bool = True
    columns: Annotated[str, _readable("columns")] | None = None
    sidecar: str | None = None
    schedule: str | None = None
    loop: str | None = None
    constants: Annotated[str, _readable("constants")] | None = None
    history: Annotated[str, _readable("history")] | None = None
    clean: Annotated[str, _readable("clean")] | None = None

    def reading(self, folder: Path | None = None) -> ReadOptions:
        """Return how measurements are read."""
        sidecar = self.sidecar
        if sidecar is not None and folder is not None:
            sidecar = str(folder / sidecar)
        return ReadOptions.from_text(
            columns=self.columns,
            sidecar=sidecar,
            schedule=self.schedule,
            loop=self.loop,
            constants=self.constants,
            history=self.history,
            clean=self.clean,
        )

    def searching(self, gap_map: str = "auto") -> dict[str, Any]:
        """Return what :func:`anhyst.identification.identify` is to be asked for."""
        return {
            "law": self.law,
            "gap_map": self.gap_map or gap_map,
            "search": self.search,
            "seed": self.seed,
            "weights": self.weights,
            "offsets": self.offsets,
            "dead_band": self.dead_band,
            "rate": self.rate,
        }
