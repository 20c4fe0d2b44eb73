"""From a measured loop to a linear actuator."""
