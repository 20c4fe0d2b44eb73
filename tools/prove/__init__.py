"""Prove that the fixed-point C has no undefined behaviour, and that each proof detects a fault."""
