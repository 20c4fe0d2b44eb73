"""
One model for all gaps
======================

Draw the force of a model at three currents on the initial magnetisation curve, for measured gaps and
for gaps between them.
"""

import matplotlib.pyplot as plt
import numpy as np

import anhyst

loops = anhyst.read_loops(anhyst.example_files("electromagnet")["loops.csv"])
model = anhyst.identify(loops, law="effective-field").model
gaps = np.linspace(0.3e-3, 0.6e-3, 31)
rising_current = np.linspace(0.0, 3.0, 61)
forces = np.array([model(rising_current, gap, history="demagnetised") for gap in gaps])
figure, ax = plt.subplots(layout="constrained")
for place in (20, 40, 60):
    ax.plot(1e3 * gaps, forces[:, place], label=f"{rising_current[place]:g} A")
ax.set_xlabel("gap [mm]")
ax.set_ylabel("force F [N], rising from demagnetised")
ax.legend(frameon=False)
