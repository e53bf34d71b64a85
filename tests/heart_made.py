"""The times at which the synthetic ventricle is measured, and where its base is marked."""

TIMES = (0.0, 0.25, 0.5, 0.75)
SHARE = 0.8
