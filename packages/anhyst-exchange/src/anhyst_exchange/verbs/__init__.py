"""The verb ``export``, as :mod:`anhyst.verbs` describes verbs."""
