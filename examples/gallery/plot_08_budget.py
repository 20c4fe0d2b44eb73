"""
Accuracy budget of fixed point
==============================

Draw the accuracy budget of a compensator with 16-bit signals: the error of the model, and the errors
that tables, number formats and sample rate add.
"""

import tempfile
from pathlib import Path

import anhyst

loops = anhyst.read_loops(anhyst.example_files("electromagnet")["loops.csv"])
model = anhyst.identify(loops, law="effective-field").model
with tempfile.TemporaryDirectory() as folder:
    compiled = anhyst.compile(model, Path(folder) / "controller", rate=20e3)
ax = compiled.plot()
ax.set_title(f"{compiled.facts()['accuracy']} by compiling")
