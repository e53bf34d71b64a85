"""From unstructured 3D points to a compact, smooth, volumetric model.

The public names; each is imported when it is first used, so that `import quadriform` stays fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from quadriform.files import load, read_points, save
    from quadriform.files.guide_points import read_guide_points
    from quadriform.fitting.fit import fit, refine
    from quadriform.fitting.outcome import Fit, SuperquadricFit
    from quadriform.fitting.superquadric_fit import fit_superquadric
    from quadriform.heart.measure import measure
    from quadriform.imaging.reading import read_volume
    from quadriform.motion.tracking import Track, track
    from quadriform.report.exchange import to_pyvista, to_trimesh
    from quadriform.report.plot import plot
    from quadriform.shapes.control_box import ControlBox
    from quadriform.shapes.mesh import Mesh
    from quadriform.shapes.model import DeformableModel
    from quadriform.shapes.moving_model import MovingModel
    from quadriform.shapes.superquadric import Superquadric

__version__ = "0.1.0"

_HOME = {
    "ControlBox": "shapes.control_box",
    "DeformableModel": "shapes.model",
    "Fit": "fitting.outcome",
    "Mesh": "shapes.mesh",
    "MovingModel": "shapes.moving_model",
    "Superquadric": "shapes.superquadric",
    "SuperquadricFit": "fitting.outcome",
    "Track": "motion.tracking",
    "fit": "fitting.fit",
    "fit_superquadric": "fitting.superquadric_fit",
    "load": "files",
    "measure": "heart.measure",
    "plot": "report.plot",
    "read_guide_points": "files.guide_points",
    "read_points": "files",
    "read_volume": "imaging.reading",
    "refine": "fitting.fit",
    "save": "files",
    "to_pyvista": "report.exchange",
    "to_trimesh": "report.exchange",
    "track": "motion.tracking",
}

__all__ = [
    "ControlBox",
    "DeformableModel",
    "Fit",
    "Mesh",
    "MovingModel",
    "Superquadric",
    "SuperquadricFit",
    "Track",
    "fit",
    "fit_superquadric",
    "load",
    "measure",
    "plot",
    "read_guide_points",
    "read_points",
    "read_volume",
    "refine",
    "save",
    "to_pyvista",
    "to_trimesh",
    "track",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"quadriform.{_HOME[name]}"), name)
    raise AttributeError(f"module 'quadriform' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
