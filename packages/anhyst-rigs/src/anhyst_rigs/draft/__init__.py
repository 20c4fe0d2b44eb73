"""Draft a complete rig from measured loops.

Values follow from the loops if possible. All others are guessed by stated rules and marked as
guesses in the files. The functions are in :mod:`anhyst_rigs.draft.drafting`.
"""
