"""A short-stroke stage: a body between magnets that ride on a long stroke."""
