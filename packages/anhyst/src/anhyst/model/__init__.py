"""The model of an actuator: parameters, model file, prediction and acceptance test."""
