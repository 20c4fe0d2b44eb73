"""Simulate many plants with many methods, and compare the results."""
