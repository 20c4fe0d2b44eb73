"""A virtual piezo stack in a flexure stage."""
