"""Export models and rigs for other tools, as FMUs and S-functions.

The command ``export`` is a function with the same names and defaults::

    import anhyst_exchange

    anhyst_exchange.export("model.toml", "model.fmu")
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from anhyst.support.lazy import lazy_names

if TYPE_CHECKING:  # for checkers and editors
    __version__: str

    from anhyst_exchange.verbs.export import export as export

__all__, __getattr__ = lazy_names("anhyst_exchange", {})


def __dir__() -> list[str]:
    return __all__
