"""The two ways a verb can end other than well."""

from __future__ import annotations


class InputError(ValueError):
    """Bad input, reported in one line: file, line or key; what is wrong; what to do.

    The command line prints it as ``anhyst: error: ...`` and exits with 2.
    """


class NegativeResult(RuntimeError):  # noqa: N818 - an answer
    """The work was done and the answer is no, such as a model that fails its acceptance test.

    The command line prints it and exits with 1.
    """


class Interrupted(RuntimeError):  # noqa: N818 - an end
    """Ctrl-C stopped the work; says what was kept.

    The command line prints it and exits with 130.
    """


class RenamedWarning(UserWarning):
    """A file says something by an older name; the text names the line and the new one.

    The command line prints it as ``anhyst: warning: ...``.
    """


class ImplausibleWarning(UserWarning):
    """A value so far from what a model knows that its unit is likely wrong.

    Issued once a call from Python; the command line prints it as ``anhyst: warning: ...``.
    """
