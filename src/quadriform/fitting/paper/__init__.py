"""The refinement as printed in the paper: displacements and control points alternately (paper 3.2, 3.3)."""
