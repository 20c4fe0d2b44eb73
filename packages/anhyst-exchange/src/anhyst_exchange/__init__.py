"""Models for other people's tools: FMUs and tables."""
