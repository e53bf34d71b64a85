"""Save, load, export.

A model file has all parameters to the last bit; meshes are for other programs.
"""

import tempfile
from pathlib import Path

import numpy as np

import quadriform as qf

points = qf.examples.rounded_box(steps=16)
model = qf.fit(points, box=(4, 4, 4)).model
with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    qf.save(model, folder / "box.json")
    qf.save(model, folder / "box.stl")
    again = qf.load(folder / "box.json")
    print(
        sorted(f"{path.name}: {path.stat().st_size} bytes" for path in folder.iterdir())
    )
print("same surface:", np.array_equal(model.mesh().vertices, again.mesh().vertices))
