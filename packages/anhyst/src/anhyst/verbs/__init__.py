"""The verbs: one file each, with the function that Python calls and the command line runs.

A file has a function of its own name, whose signature and docstring become the options and the help
of the command. It may also say how the command presents the result: see
:class:`anhyst.cli.generate.Verb`. A file imports what it works with inside its functions, so that
the help is shown at once.
"""

from pkgutil import iter_modules


def names() -> list[str]:
    """Return the names of the verbs."""
    return sorted(module.name for module in iter_modules(__path__))
