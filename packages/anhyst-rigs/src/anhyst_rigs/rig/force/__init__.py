"""Simulate the rig of open-loop force control: solenoid, instruments and firmware, tick by tick."""
