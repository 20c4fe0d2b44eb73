"""
Identified model on the measured loops
======================================

Identify a model from the loops at all gaps together; this takes seconds.
"""

import anhyst

loops = anhyst.read_loops(anhyst.example_files("electromagnet")["loops.csv"])
identification = anhyst.identify(loops)
ax = identification.plot()
ax.set_title(identification.model.facts()["fit"])
