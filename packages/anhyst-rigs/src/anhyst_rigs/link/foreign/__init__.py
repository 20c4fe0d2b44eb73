"""Variables of a firmware that anhyst does not know, and their access over XCP."""
