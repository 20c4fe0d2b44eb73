"""Calculate the current of an actuator for a demanded output, from a model or from measured loops."""
