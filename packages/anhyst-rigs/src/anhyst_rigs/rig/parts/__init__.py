"""Parts of virtual plants: irons and magnets, simulated tick by tick.

This package does not use the laws that anhyst identifies. Therefore, a model cannot succeed only
because the plant has the same structure.
"""
