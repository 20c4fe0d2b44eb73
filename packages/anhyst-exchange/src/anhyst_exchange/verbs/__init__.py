"""The command ``export``; :mod:`anhyst.verbs` describes the form of this module."""
