"""The benchmarks of `next_patient.py`: data that the defaults were not tuned on, one module for each source."""
