"""Whether a model still fits its magnet, watched while the magnet moves."""
