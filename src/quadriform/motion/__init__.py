"""A model that moves: one superquadric, control points that are functions of time (after the companion paper)."""
