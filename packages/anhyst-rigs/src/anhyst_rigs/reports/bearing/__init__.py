"""The report of a simulated bearing, and its figures."""
