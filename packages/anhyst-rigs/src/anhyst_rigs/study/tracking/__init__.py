"""Tracking with feedforward: what compensation of hysteresis gains on a stage that follows set-points."""
