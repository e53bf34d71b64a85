"""The refinement of the paper to the letter: displacements, then control points, alternately (paper 3.2, 3.3)."""
