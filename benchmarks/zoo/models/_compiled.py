"""Compilation of loops over samples with numba, which is an optional dependency."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from ..model import Refusal

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    """Compile a function with numba; without numba, a call of it raises `Refusal`."""
    try:
        from numba import njit
    except ImportError:

        def refuse(*_: object) -> None:
            raise Refusal("numba is not installed; install the dependency group 'bench'")

        return cast("Function", refuse)
    return cast("Function", njit(cache=True, error_model="numpy")(function))
