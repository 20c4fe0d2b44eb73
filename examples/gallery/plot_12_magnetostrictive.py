"""
A magnetostrictive rod
======================

Strain over field under several prestresses: a butterfly, even in the field.
"""

import anhyst

loops = anhyst.read_loops(anhyst.example_files("magnetostrictive")["loops.csv"])
ax = loops.plot()
ax.set_title("strain of a rod under prestress")
