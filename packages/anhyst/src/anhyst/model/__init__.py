"""The model of an actuator: parameters over the gap, model file, prediction, acceptance test."""
