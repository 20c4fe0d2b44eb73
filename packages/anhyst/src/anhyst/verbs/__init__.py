"""The verbs: one file each, with the function that Python calls and the command line runs.

A file has a function of its own name, whose signature and docstring become the options and the help
of the command. It may also say how the command presents the result: see
:class:`anhyst.cli.generate.Verb`. A file imports what it works with inside its functions, so that
the help is shown at once.

Another package has such a folder too, and names it in an entry point of the group ``anhyst.verbs``.
"""
