"""Reports of studies: a self-contained HTML page for each, its pictures, and what a terminal shows."""
