"""The two ways a verb can end other than well, and what a search meets on its way."""

from __future__ import annotations

import copyreg
from copy import copy
from typing import Any, Self

from anhyst.support.wording import word_for_reader


class _CodedError(Exception):
    """An error with a code for programs and a text that says what to do."""

    def __init__(self, text: str, *, code: str, key: str = "") -> None:
        super().__init__(text)
        self.code = code
        self.key = key

    def __reduce__(self) -> tuple[Any, ...]:
        # As it stands, whatever its class is made from: errors come back from other processes.
        return copyreg.__newobj__, (type(self), *self.args), self.__dict__  # type: ignore[attr-defined]

    def __str__(self) -> str:
        return word_for_reader(str(self.args[0]))

    def with_location(self, location: object) -> Self:
        """Return the same error with the place in front of its text."""
        error = copy(self)
        error.args = (f"{location}: {self.args[0]}",)
        return error


class InputError(_CodedError, ValueError):
    """Bad input, reported in one line: file, line or key; what is wrong; what to do.

    The command line prints it as ``anhyst: error: ...`` and exits with 2. In Python, the text names
    arguments in place of options.

    Parameters
    ----------
    text : str
        The line.
    code : str
        What is wrong, in a few small letters that stay when the line is worded otherwise, such as
        ``no-such-file``.
    key : str, optional
        Key of a file, option, column or parameter that is wrong; empty where there is none.
    """


def wrong_key(key: str, text: str, *, code: str) -> InputError:
    """Return the error of a key, option, column or parameter, which its text begins with."""
    return InputError(f"{key}: {text}", code=code, key=key)


def wrong_type(
    argument: str, expected: str, value: object, *, is_in_list: bool = False
) -> InputError:
    """Return the error of an argument, such as ``"identify: loops"``, of the wrong type."""
    given_type = type(value).__name__ if value is not None else "None"
    for name in ("loops", "model"):
        if hasattr(value, "loops") and hasattr(value, "model") and argument.endswith(name):
            given_type += f"; give its {name}"
    prefix = "a list with " if is_in_list else ""
    return InputError(
        f"{argument} must be {expected}, not {prefix}{given_type}", code="wrong-type", key=argument
    )


class NegativeResult(_CodedError, RuntimeError):  # noqa: N818 - an answer
    """The work was done and the answer is no, such as a model that fails its acceptance test.

    The command line prints it and exits with 1.

    Parameters
    ----------
    text : str
        The line.
    code : str
        What the answer is, as that of an `InputError`.
    key : str, optional
        What it is about, if that has a name.
    """


class Interrupted(RuntimeError):  # noqa: N818 - an end
    """Ctrl-C stopped the work; says what was kept.

    The command line prints it and exits with 130.
    """


class ImplausibleWarning(UserWarning):
    """A value so far from what a model knows that its unit is likely wrong.

    Issued once a call from Python; the command line prints it as ``anhyst: warning: ...``.
    """


class NoResponseError(ArithmeticError):
    """A law has no answer for its parameters."""


class NoUsableStartError(InputError):
    """No set of parameters that a search begins with comes near the loops."""

    def __init__(self) -> None:
        super().__init__(
            "the law comes nowhere near these loops, whatever its parameters; look for wrong signs "
            "or columns with 'anhyst inspect --plot'",
            code="nowhere-near",
        )


class ReturnPointMemoryWarning(UserWarning):
    """Loops show that an iron does not keep its turning points; says what was done about it."""
