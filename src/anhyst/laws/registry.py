"""The hysteresis laws by name. A further one is one more entry, whoever makes it."""

from __future__ import annotations

from anhyst.laws.effective_field import EFFECTIVE_FIELD
from anhyst.laws.jiles_atherton_1986 import JILES_ATHERTON_1986
from anhyst.laws.law import Law
from anhyst.laws.play_cells import PLAY_CELLS, PLAY_CELLS_LANGEVIN

LAWS: dict[str, Law] = {
    law.name: law for law in (EFFECTIVE_FIELD, JILES_ATHERTON_1986, PLAY_CELLS, PLAY_CELLS_LANGEVIN)
}

DEFAULT_LAW = EFFECTIVE_FIELD.name


def laws_with_compensator() -> str:
    """Return the options to identify with one."""
    return " or ".join(f"--law {law.name}" for law in LAWS.values() if law.least_slope)
