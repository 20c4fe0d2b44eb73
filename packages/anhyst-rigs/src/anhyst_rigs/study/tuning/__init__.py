"""Tune controller gains for stated aims over all gaps, step heights and loads of a rig."""
