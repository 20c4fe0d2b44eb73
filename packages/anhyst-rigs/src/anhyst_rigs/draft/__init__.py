"""Drafts: a rig of one's own from measured loops, complete and ready to run.

What can be derived from the loops is derived; what cannot is guessed by stated rules, and every
guess is marked as one in the files. :mod:`anhyst_rigs.draft.drafting` is where it begins.
"""
