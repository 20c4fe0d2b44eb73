"""
Linearised bearing
==================

Draw the unstable pole of a bearing against the gap; a position controller must be faster. The plant
is a ``StateSpace`` of python-control with named signals.
"""

import matplotlib.pyplot as plt
import numpy as np

import anhyst
import anhyst_rigs

rig = anhyst.example_files("bearing")["rig.toml"]
gaps = np.linspace(0.35e-3, 0.6e-3, 6)
poles = [anhyst_rigs.linearise(rig, gap=gap).poles().real.max() for gap in gaps]
figure, ax = plt.subplots(layout="constrained")
ax.plot(1e3 * gaps, np.array(poles) / (2.0 * np.pi), "o-")
ax.set_xlabel("gap [mm]")
ax.set_ylabel("unstable pole [Hz]")
