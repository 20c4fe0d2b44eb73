"""
A piezo stage follows a triangle
================================

Behind the same feedback: a constant, the best curve without memory, and the compiled inverse in
fixed point.
"""

import anhyst
import anhyst_rigs

found = anhyst_rigs.simulate(anhyst.example_files("piezo")["rig.toml"])
ax = found.plot()
ax.set_ylim(-800.0, 800.0)
rms = found.to_dataframe()["rms_m"]
ax.set_title(f"rms with compensation: {rms.iloc[-1] / rms.iloc[0]:.2f} of that without")
