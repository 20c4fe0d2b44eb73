"""Open-loop force control, as in section III of the paper."""
