"""
Magnetostrictive rod
====================

Draw the strain against the field under several prestresses. The loops are even in the field
(butterfly loops).
"""

import anhyst

loops = anhyst.read_loops(anhyst.example_files("magnetostrictive")["loops.csv"])
ax = loops.plot()
ax.set_title("strain of a rod under prestress")
