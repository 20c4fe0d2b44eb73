"""
Linear output from a hysteretic magnet
======================================

Demand a triangular force. If the current is proportional to the square root of the demand, force
against demand is a loop. With the current of the inverse model, the force equals the demand.
"""

import matplotlib.pyplot as plt
import numpy as np

import anhyst

loops = anhyst.read_loops(anhyst.example_files("electromagnet")["loops.csv"])
magnet = anhyst.identify(loops).model
demand = 5.0 + 195.0 * (1.0 - np.abs(np.linspace(-1.0, 1.0, 400)))
root = np.sqrt(demand / demand.max())
max_current = magnet.inverse(demand, 0.3e-3, history="demagnetised").max()
figure, ax = plt.subplots(layout="constrained")
for name, current in (
    ("square root", max_current * root),
    ("inverse model", magnet.inverse(demand, 0.3e-3, history="demagnetised")),
):
    ax.plot(demand, magnet(current, 0.3e-3, history="demagnetised"), label=name)
ax.set_xlabel("demanded force [N]")
ax.set_ylabel("force [N]")
ax.legend(frameon=False)
