"""The rig of a magnetic bearing: plant, instruments and controller in lock-step."""
