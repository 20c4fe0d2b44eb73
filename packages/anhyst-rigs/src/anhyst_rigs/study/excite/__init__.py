"""A drive that measures loops: designed within limits, run on the rig, written as a measurement."""
