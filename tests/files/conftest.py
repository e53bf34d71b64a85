"""A model with uneven numbers, and the meshes that come from it."""

import numpy as np
import pytest

from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.pose import rotation_from_euler
from quadriform.shapes.superquadric import Superquadric


@pytest.fixture
def model(rng: np.random.Generator) -> DeformableModel:
    superquadric = Superquadric(
        semi_axes=rng.uniform(20, 60, 3),
        exponents=(0.7, 1.1),
        rotation=rotation_from_euler(rng.normal(size=3)),
        translation=rng.normal(size=3) * 100,
    )
    box = ControlBox.around(superquadric)
    moved = box.control_points + rng.normal(size=box.control_points.shape)
    return DeformableModel({"surface": superquadric}, box.with_control_points(moved), "LPS", "mm", "0f" * 32)


@pytest.fixture
def mesh(model: DeformableModel) -> Mesh:
    return model.mesh(resolution=6)
