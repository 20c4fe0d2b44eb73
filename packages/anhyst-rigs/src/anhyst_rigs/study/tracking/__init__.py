"""Tracking of set-points with feedforward: effect of hysteresis compensation on a stage."""
