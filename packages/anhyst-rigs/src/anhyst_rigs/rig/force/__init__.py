"""The rig of open-loop force control: solenoid, instruments, firmware, in lock-step."""
