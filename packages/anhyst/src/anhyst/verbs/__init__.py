"""The commands of anhyst: one module each, with the function that Python and the command line call.

Each module defines a function with the name of the module. The signature and the docstring of this
function become the options and the help of the command. The module may also define how the terminal
shows the result: see :class:`anhyst.cli.generate.Verb`. A module imports its tools inside its
functions, so that the help appears quickly.

Other packages can add commands: a folder of such modules, and an entry point of the group
``anhyst.verbs`` that names this folder.
"""
