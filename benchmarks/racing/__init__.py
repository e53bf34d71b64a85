"""Races against rivals on the same work, for `benchmarks/races.py`."""
