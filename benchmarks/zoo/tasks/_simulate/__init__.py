"""Equations and drives of the simulated tasks; no equation is a law of the package."""
