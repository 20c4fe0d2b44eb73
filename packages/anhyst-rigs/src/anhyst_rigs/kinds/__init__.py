"""Define the kinds of rigs; each kind has a module with the record of its commands."""
