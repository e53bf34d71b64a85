"""Comparisons against baselines on the same work, for `benchmarks/comparisons.py`."""
