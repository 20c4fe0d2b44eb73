"""
Benefit of a hysteresis model
=============================

Compare the error of the best single-valued curve for each loop with the noise, which limits every
model.
"""

import anhyst

loops = anhyst.read_loops(anhyst.example_files("electromagnet")["loops.csv"])
inspection = anhyst.inspect(loops)
ax = inspection.plot()
ax.set_title(f"worth it: {inspection.verdict.level}")
