"""Run simulated test cases on a rig, and assess the results."""
