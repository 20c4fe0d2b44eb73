"""
Piezo stack
===========

Identify a model from voltage to displacement with the same functions as for a magnet. The fit
includes loop, lag and creep.
"""

import anhyst

loops = anhyst.read_loops(anhyst.example_files("piezo")["loops.csv"])
identification = anhyst.identify(loops)
ax = identification.plot()
ax.set_title(identification.model.facts()["fit"])
