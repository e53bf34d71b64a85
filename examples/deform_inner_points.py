"""Move what lies inside.

The deformation is defined in the whole box, so it carries any points, such as those of a tumour or of fibres.
"""

import numpy as np

import quadriform as qf

body = qf.Superquadric(
    semi_axes=np.array([40.0, 30.0, 20.0]), exponents=np.array([1.0, 1.0])
)
bent = body.mesh(12).vertices
bent = bent + np.outer(0.006 * bent[:, 0] ** 2, [0, 0, 1])
model = qf.fit(bent).model

inner = (
    0.5 * model.superquadric().mesh(8).vertices + 0.5 * model.superquadric().translation
)
moved = model.deform(inner)
back = model.undeform(moved)
print(
    f"moved by up to {np.linalg.norm(moved - inner, axis=1).max():.1f}, and back to {np.abs(back - inner).max():.0e}"
)
