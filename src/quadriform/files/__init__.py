"""Points, meshes and models in and out: budgets before reading, all-or-nothing writes, no pickle anywhere."""

from quadriform.files.meshes import read_mesh, write_mesh
from quadriform.files.models import read_model, write_model
from quadriform.files.points import read_points
from quadriform.files.reading import sha256_of
from quadriform.files.save_and_load import load, save

__all__ = ["load", "read_mesh", "read_model", "read_points", "save", "sha256_of", "write_mesh", "write_model"]
