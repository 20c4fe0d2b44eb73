"""
Is a hysteresis model worth it?
===============================

What the best curve without memory misses of each loop, beside the noise that no model gets below.
"""

import anhyst

loops = anhyst.read_loops(anhyst.example_files("electromagnet")["loops.csv"])
inspection = anhyst.inspect(loops)
ax = inspection.plot()
ax.set_title(f"worth it: {inspection.verdict.level}")
