"""A short-stroke stage: a mass between two magnets that ride on a long stroke."""
