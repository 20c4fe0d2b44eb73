"""What the pages and figures of all studies share."""
