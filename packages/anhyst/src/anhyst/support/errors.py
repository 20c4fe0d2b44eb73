"""The errors and warnings of anhyst.

`InputError` is for bad input, `NegativeResult` for a completed work with a negative result. Errors
carry a code for programs and a text that states the remedy.
"""

from __future__ import annotations

import copyreg
from copy import copy
from typing import Any, Self

from anhyst.support.wording import word_for_reader


class _CodedError(Exception):
    """An error with a code for programs, and a text that states the remedy."""

    def __init__(self, text: str, *, code: str, key: str = "") -> None:
        super().__init__(text)
        self.code = code
        self.key = key

    def __reduce__(self) -> tuple[Any, ...]:
        # Errors are pickled by worker processes. Unpickling must not call __init__ of a subclass.
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]

    def __str__(self) -> str:
        return word_for_reader(str(self.args[0]))

    def with_location(self, location: object) -> Self:
        """Return the same error with a location in front of its text."""
        error = copy(self)
        error.args = (f"{location}: {self.args[0]}",)
        return error


class InputError(_CodedError, ValueError):
    """Bad input, reported in one line: the file, line or key; the fault; the remedy.

    The command line prints it as ``anhyst: error: ...`` and exits with 2. In Python, the text names
    arguments instead of options.

    Parameters
    ----------
    text : str
        The line.
    code : str
        Name of the fault, such as ``no-such-file``. It stays the same if the text changes.
    key : str, optional
        The wrong key, option, column or parameter; empty if there is none.
    """


def wrong_key(key: str, text: str, *, code: str) -> InputError:
    """Return the error for a key, option, column or parameter. Its text begins with the key."""
    return InputError(f"{key}: {text}", code=code, key=key)


def wrong_type(argument: str, expected_type: str, value: object, *, is_in_list: bool = False) -> InputError:
    """Return the error for an argument of a wrong type; its text begins with the argument."""
    given_type = type(value).__name__ if value is not None else "None"
    for name in ("loops", "model"):
        if hasattr(value, "loops") and hasattr(value, "model") and argument.endswith(name):
            given_type += f"; give its {name}"
    prefix = "a list with " if is_in_list else ""
    return InputError(
        f"{argument} must be {expected_type}, not {prefix}{given_type}", code="wrong-type", key=argument
    )


class NegativeResult(_CodedError, RuntimeError):  # noqa: N818 - an answer
    """The work was done and its result is negative, such as a model that fails its acceptance test.

    The command line prints it and exits with 1.

    Parameters
    ----------
    text : str
        The line.
    code : str
        Name of the result, as for `InputError`.
    key : str, optional
        The object of the result, if it has a name.
    """


class Interrupted(RuntimeError):  # noqa: N818 - an end
    """Ctrl-C stopped the work. The text states which results were saved.

    The command line prints it and exits with 130.
    """


class ImplausibleWarning(UserWarning):
    """A value is so far outside the range of a model that its unit is probably wrong.

    It is issued once per call from Python. The command line prints it as ``anhyst: warning: ...``.
    """


class NoResponseError(ArithmeticError):
    """A hysteresis law has no solution for its parameters."""


class NoUsableStartError(InputError):
    """None of the initial parameter sets of a search comes near the measured loops."""

    def __init__(self) -> None:
        super().__init__(
            "the law does not fit these loops with any initial parameters; look for wrong signs or "
            "columns with 'anhyst inspect --plot'",
            code="nowhere-near",
        )


class ReturnPointMemoryWarning(UserWarning):
    """The loops show iron without return-point memory. The text states how the loops were handled."""
