"""
What fixed point costs
======================

The accuracy budget of a compensator in 16-bit signals: what the model misses, and what tables,
number formats and the sample rate add.
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
