"""Run simulated test cases on a rig and assess their results."""
