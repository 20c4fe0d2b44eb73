"""
Piezo stage that follows a triangle
===================================

Compare three inverses with the same feedback: a constant, the best single-valued curve, and the
compiled inverse in fixed point.
"""

import anhyst
import anhyst_rigs

tracking_study = anhyst_rigs.simulate(anhyst.example_files("piezo")["rig.toml"])
ax = tracking_study.plot()
ax.set_ylim(-800.0, 800.0)
rms = tracking_study.to_dataframe()["rms_m"]
ax.set_title(f"rms with compensation: {rms.iloc[-1] / rms.iloc[0]:.2f} of that without")
