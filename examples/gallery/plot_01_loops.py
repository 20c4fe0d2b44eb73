"""
Loops as they were measured
===========================

Force over current of an electromagnet at four gaps. On the way down the force lies above that on
the way up: one current has many forces.
"""

import anhyst

loops = anhyst.read_loops(anhyst.example_files("electromagnet")["loops.csv"])
ax = loops.plot()
ax.set_title("measured force of an electromagnet")
