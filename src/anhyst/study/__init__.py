"""Studies: what is tried on a rig, and what comes out."""
