"""The rig of open-loop force control: solenoid, instruments and firmware in lock-step."""
