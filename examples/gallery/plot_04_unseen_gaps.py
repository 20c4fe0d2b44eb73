"""
At gaps that nobody measured
============================

A model from loops at four gaps, held against loops at two others that it has not seen.
"""

import anhyst

files = anhyst.example_files("electromagnet")
model = anhyst.identify(anhyst.read_loops(files["loops.csv"])).model
unseen = anhyst.read_loops(files["unseen.csv"])
ax = unseen.plot()
for loop in unseen.loops:
    ax.plot(loop.input, model(loop.input, loop.schedule, loop.time, loop.history), "k--", lw=0.8)
ax.set_title("measured, and predicted (dashed)")
