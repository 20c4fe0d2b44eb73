"""Studies: test cases on a rig, and what comes out."""
