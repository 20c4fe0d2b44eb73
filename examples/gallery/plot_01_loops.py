"""
Measured loops
==============

Draw the force of an electromagnet against its current at four gaps. The descending branch is above
the ascending branch: the force for a current depends on the history.
"""

import anhyst

loops = anhyst.read_loops(anhyst.example_files("electromagnet")["loops.csv"])
ax = loops.plot()
ax.set_title("measured force of an electromagnet")
