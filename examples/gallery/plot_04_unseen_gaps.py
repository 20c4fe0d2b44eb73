"""
Prediction at withheld gaps
===========================

Compare a model from loops at four gaps with loops at two other gaps, which were not fitted.
"""

import anhyst

files = anhyst.example_files("electromagnet")
model = anhyst.identify(anhyst.read_loops(files["loops.csv"])).model
unseen_loops = anhyst.read_loops(files["unseen.csv"])
ax = unseen_loops.plot()
for loop in unseen_loops.loops:
    ax.plot(loop.input, model(loop.input, loop.schedule, loop.time, loop.history), "k--", lw=0.8)
ax.set_title("measured, and predicted (dashed)")
