"""Prove the fixed-point C free of undefined behaviour; each proof is shown to see a fault."""
