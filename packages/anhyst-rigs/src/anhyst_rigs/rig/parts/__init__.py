"""Virtual plants: irons, magnets, amplifiers and sensors, stepped in virtual time.

Nothing here knows the laws that anhyst identifies, so that a model cannot succeed by construction.
"""
