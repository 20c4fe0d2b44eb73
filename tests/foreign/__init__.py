"""Magnets and files of other people: what nobody here made the package for."""
