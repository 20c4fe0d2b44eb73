"""
Two laws on the same loops
==========================

Compare the residuals of the Jiles-Atherton law and of play cells with the measured force.
"""

import matplotlib.pyplot as plt

import anhyst

loops = anhyst.read_loops(anhyst.example_files("electromagnet")["loops.csv"]).at(0.3e-3)
figure, ax = plt.subplots(layout="constrained")
for law in ("effective-field", "play-cells"):
    table = anhyst.identify(loops, law=law).to_dataframe()
    rms = (table["F_N_residual"] ** 2).mean() ** 0.5
    ax.plot(table["I_A"], table["F_N_residual"], ".", ms=2, label=f"{law}, {rms:.2f} N rms")
ax.set_xlabel("current I [A]")
ax.set_ylabel("measured less model [N]")
ax.legend(frameon=False)
