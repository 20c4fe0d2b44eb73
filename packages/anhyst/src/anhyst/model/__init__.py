"""The model of an actuator: parameters over the gap, its file, prediction, acceptance."""
