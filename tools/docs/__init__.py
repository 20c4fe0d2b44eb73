"""Build the documentation site from hand-written pages, a generated reference and a gallery."""
