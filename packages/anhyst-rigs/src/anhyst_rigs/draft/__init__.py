"""Draft a complete rig from measured loops.

Values follow from the loops if possible. Others are guessed by stated rules and are marked as
guesses in the files. :mod:`anhyst_rigs.draft.drafting` has the entry points.
"""
