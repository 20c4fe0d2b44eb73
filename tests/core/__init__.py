"""Claims about the C core."""
