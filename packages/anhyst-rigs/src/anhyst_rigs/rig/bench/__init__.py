"""Provide benches: a virtual or real rig with its controller, for interactive use by an operator."""
