"""Solid iron in a model: layers of its law between which the field diffuses.

Layer ``j`` of ``N``, the surface first, has a share ``phi_j`` of the section and a field ``H_j`` of
its own; ``S_j`` is the flux density in it and deeper, over the whole section::

    H_(j-1) = H_j + gamma/(N - 1) * dS_j/dt,                j = 2..N
    c_H(gap) * (input - in_0) = l*H_l + (1 - l)*H_1 + rho(gap)*B/mu0,      B = S_1

where sheets, a share ``l`` of the path, take the field ``H_l`` that the whole flux asks for. At
rest all fields are alike, and the model is that of one layer (docs/rate.md).
"""

from __future__ import annotations

from dataclasses import dataclass

from anhyst.support.errors import InputError

MOST_LAYERS = 16


@dataclass(frozen=True)
class Layers:
    """How an iron is cut into layers; ``gamma`` of the model says how late the middle is."""

    count: int  # 2 to 16
    surface: float  # share of the first layer in the section, above 0 and below 1
    laminated: float = 0.0  # share of the path in sheets, 0 or above and below 1

    def __post_init__(self) -> None:
        for key, wrong, wanted in (
            ("count", not 2 <= self.count <= MOST_LAYERS, f"from 2 to {MOST_LAYERS}"),
            ("surface", not 0.0 < self.surface < 1.0, "above 0 and below 1"),
            ("laminated", not 0.0 <= self.laminated < 1.0, "from 0 to below 1"),
        ):
            if wrong:
                raise InputError(
                    f"model layers: {key} is {getattr(self, key):g}; give a number {wanted}",
                    code="out-of-range",
                    key=key,
                )

    @property
    def memories(self) -> int:
        """Number of states of the law that the iron consists of: layers, and the sheets."""
        return self.count + 1

    def __str__(self) -> str:
        """Say how the iron is cut."""
        return (
            f"{self.count}, {100.0 * self.surface:.3g} % of the section at the surface, "
            f"{100.0 * self.laminated:.3g} % of the path laminated"
        )
