"""Report studies: each has a self-contained HTML page, figures, and terminal output."""
