"""A mesh to a model, and back to a mesh.

A few large triangles are sampled over their area; the model is written as a mesh that other programs open.
"""

import tempfile
from pathlib import Path

import trimesh

import quadriform as qf

mesh = trimesh.creation.capsule(height=60, radius=20)
fit = qf.fit(mesh)
surface = qf.to_trimesh(fit)
print(
    f"volume {surface.volume:.0f}, of the mesh {mesh.volume:.0f}; closed: {surface.is_watertight}"
)
with tempfile.TemporaryDirectory() as folder:
    qf.save(fit.model, Path(folder) / "capsule.ply")
