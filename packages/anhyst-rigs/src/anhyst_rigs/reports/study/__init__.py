"""Provide the parts that the pages and figures of all studies share."""
