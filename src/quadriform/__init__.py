"""From unstructured 3D points to a compact, smooth, volumetric model.

The public names; each is imported when it is first used, so that `import quadriform` stays fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from quadriform.files import load, read_points, save
    from quadriform.fitting.fit import fit, refine
    from quadriform.fitting.outcome import Fit, SuperquadricFit
    from quadriform.fitting.superquadric_fit import fit_superquadric
    from quadriform.imaging.reading import read_volume
    from quadriform.shapes.control_box import ControlBox
    from quadriform.shapes.mesh import Mesh
    from quadriform.shapes.model import DeformableModel
    from quadriform.shapes.superquadric import Superquadric

__version__ = "0.1.0"

_HOME = {
    "ControlBox": "shapes.control_box",
    "DeformableModel": "shapes.model",
    "Fit": "fitting.outcome",
    "Mesh": "shapes.mesh",
    "Superquadric": "shapes.superquadric",
    "SuperquadricFit": "fitting.outcome",
    "fit": "fitting.fit",
    "fit_superquadric": "fitting.superquadric_fit",
    "load": "files",
    "read_points": "files",
    "read_volume": "imaging.reading",
    "refine": "fitting.fit",
    "save": "files",
}

__all__ = [
    "ControlBox",
    "DeformableModel",
    "Fit",
    "Mesh",
    "Superquadric",
    "SuperquadricFit",
    "fit",
    "fit_superquadric",
    "load",
    "read_points",
    "read_volume",
    "refine",
    "save",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"quadriform.{_HOME[name]}"), name)
    raise AttributeError(f"module 'quadriform' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
