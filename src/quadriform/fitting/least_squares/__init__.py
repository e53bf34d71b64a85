"""Linear least squares for control points: equations, regularisers and their weight, uncertainty (paper 3.2.3, 4)."""
