"""From unstructured 3D points to a compact, smooth, volumetric model.

The public names; each is imported when it is first used, so that `import quadriform` stays fast.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from quadriform import examples
    from quadriform.files import load, read_points, save
    from quadriform.files.guide_points import read_guide_point_frames, read_guide_points
    from quadriform.fitting.fit import refine
    from quadriform.fitting.result import Fit, SuperquadricFit
    from quadriform.fitting.superquadric.fit import fit_superquadric
    from quadriform.heart.measure import measure
    from quadriform.imaging.fit_files import fit
    from quadriform.imaging.reading import read_volume
    from quadriform.motion.tracking import Track, track
    from quadriform.report.exchange import to_pyvista, to_trimesh
    from quadriform.report.notebook import show
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
    "Fit": "fitting.result",
    "Mesh": "shapes.mesh",
    "MovingModel": "shapes.moving_model",
    "Superquadric": "shapes.superquadric",
    "SuperquadricFit": "fitting.result",
    "Track": "motion.tracking",
    "fit": "imaging.fit_files",
    "fit_superquadric": "fitting.superquadric.fit",
    "load": "files",
    "measure": "heart.measure",
    "plot": "report.plot",
    "read_guide_point_frames": "files.guide_points",
    "read_guide_points": "files.guide_points",
    "read_points": "files",
    "read_volume": "imaging.reading",
    "refine": "fitting.fit",
    "save": "files",
    "show": "report.notebook",
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
    "examples",
    "fit",
    "fit_superquadric",
    "load",
    "measure",
    "plot",
    "read_guide_point_frames",
    "read_guide_points",
    "read_points",
    "read_volume",
    "refine",
    "save",
    "show",
    "to_pyvista",
    "to_trimesh",
    "track",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"quadriform.{_HOME[name]}"), name)
    if name == "examples":
        return import_module("quadriform.examples")
    raise AttributeError(f"module 'quadriform' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)


_SHOWN = ("DeformableModel", "Fit", "MovingModel", "Track")


def _show_in_notebooks() -> None:
    """Tell a notebook how models and fits show themselves; their own layers know no pictures."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    if shell is None:
        return
    formatter = shell.display_formatter.formatters["text/html"]
    for name in _SHOWN:
        formatter.for_type_by_name(
            f"quadriform.{_HOME[name]}", name, lambda thing: import_module("quadriform.report.notebook").as_html(thing)
        )


_show_in_notebooks()
