"""Prove that the fixed-point C has no undefined behaviour. Each proof must also detect a seeded
fault."""
