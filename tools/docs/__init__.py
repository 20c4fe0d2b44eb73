"""The documentation site: hand-written pages, generated reference, gallery."""
