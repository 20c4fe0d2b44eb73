"""Reports of studies: a self-contained HTML page each, its figures, and the terminal output."""
