"""The verbs of rigs, as :mod:`anhyst.verbs` describes them."""
