"""From a model or loops to a compensator: the current that a force needs, sample by sample."""
