"""Compile a model to verified fixed-point C: formats, tables, accuracy budget, sources."""
