"""Superquadrics fitted to points (paper 2.3, A.3), and the robust fit that the default starts from."""
