"""The kinds of rigs: one module each, with the record of all commands for such a rig."""
