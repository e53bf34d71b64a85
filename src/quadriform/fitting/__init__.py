"""How points become a model: start, superquadric fit, matching, regularity, refinement (paper 2.3, 3.2, 3.3, 4)."""
