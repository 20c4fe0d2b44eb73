"""
Minor loops
===========

Predict the response of demagnetised iron to a current that reverses earlier each time. The model
stores every reversal point, so that the result is a spiral of smaller and smaller loops.
"""

from itertools import pairwise

import numpy as np

import anhyst

loops = anhyst.read_loops(anhyst.example_files("electromagnet")["loops.csv"])
model = anhyst.identify(loops, law="effective-field").model
turns = [0.0, 3.0, 0.3, 2.7, 0.6, 2.4, 0.9, 2.1, 1.2, 1.8]
ramps = [np.linspace(start, end, 80) for start, end in pairwise(turns)]
current = np.concatenate(ramps)
ax = model.predict(current, 0.3e-3, history="demagnetised").plot()
ax.set_title("inner loops at 0.3 mm")
