"""What the pages of all studies share."""
