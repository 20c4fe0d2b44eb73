"""
Identified model on the measured loops
======================================

Identify a model from the loops at all gaps together; this takes seconds.
"""

import anhyst

loops = anhyst.read_loops(anhyst.example_files("electromagnet")["loops.csv"])
found = anhyst.identify(loops)
ax = found.plot()
ax.set_title(found.model.facts()["fit"])
