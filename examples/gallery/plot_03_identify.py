"""
The model on the measured loops
===============================

Identified from all loops at all gaps at once, in seconds.
"""

import anhyst

loops = anhyst.read_loops(anhyst.example_files("electromagnet")["loops.csv"])
found = anhyst.identify(loops)
ax = found.plot()
ax.set_title(found.model.facts()["fit"])
