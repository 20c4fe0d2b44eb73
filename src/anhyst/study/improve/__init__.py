"""A better model for a controller that runs: measured, identified, compared, compiled for its board."""
