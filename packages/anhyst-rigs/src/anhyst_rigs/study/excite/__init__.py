"""Design a drive that measures loops within limits, run it on the rig, and write the measurement."""
