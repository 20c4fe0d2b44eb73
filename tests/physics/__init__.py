"""Claims about the physics of the laws."""
