"""The commands for rigs; :mod:`anhyst.verbs` describes the form of these modules."""
