"""
A piezo stack
=============

Voltage to displacement: the same verbs, another actuator. Loop, lag and creep are identified
together.
"""

import anhyst

loops = anhyst.read_loops(anhyst.example_files("piezo")["loops.csv"])
found = anhyst.identify(loops)
ax = found.plot()
ax.set_title(found.model.facts()["fit"])
