"""The kinds of rigs: one file each, with the record of all that can be done with such a rig."""
