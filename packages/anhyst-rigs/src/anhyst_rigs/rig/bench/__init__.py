"""Benches: a rig and its controller, virtual or of hardware, as one sees and operates them."""
