"""The report of a model, and its figures."""
