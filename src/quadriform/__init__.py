"""From unstructured 3D points to a compact, smooth, volumetric model.

The public names; each is imported when it is first used, so that `import quadriform` stays fast.
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from quadriform import examples as examples
    from quadriform.files import load as load
    from quadriform.files import read_points as read_points
    from quadriform.files import save as save
    from quadriform.files.guide_points import read_guide_point_frames as read_guide_point_frames
    from quadriform.files.guide_points import read_guide_points as read_guide_points
    from quadriform.fitting.fit import refine as refine
    from quadriform.fitting.result import Fit as Fit
    from quadriform.fitting.result import SuperquadricFit as SuperquadricFit
    from quadriform.fitting.superquadric.fit import fit_superquadric as fit_superquadric
    from quadriform.heart.measure import measure as measure
    from quadriform.heart.measures_table import Measures as Measures
    from quadriform.heart.measures_table import write_measures as write_measures
    from quadriform.imaging.fit_files import fit as fit
    from quadriform.imaging.image_points import points_from_image as points_from_image
    from quadriform.imaging.reading import read_volume as read_volume
    from quadriform.imaging.segmentation import segment as segment
    from quadriform.imaging.selection import Labels as Labels
    from quadriform.imaging.selection import Percentile as Percentile
    from quadriform.imaging.ventricle import ventricle_from_labels as ventricle_from_labels
    from quadriform.imaging.ventricle import ventricle_from_perfusion as ventricle_from_perfusion
    from quadriform.imaging.volume import Volume as Volume
    from quadriform.motion.tracking import Track as Track
    from quadriform.motion.tracking import track as track
    from quadriform.report.exchange import to_pyvista as to_pyvista
    from quadriform.report.exchange import to_trimesh as to_trimesh
    from quadriform.report.notebook import show as show
    from quadriform.report.plot import plot as plot
    from quadriform.shapes.comparison import dice as dice
    from quadriform.shapes.comparison import surface_distances as surface_distances
    from quadriform.shapes.control_box import ControlBox as ControlBox
    from quadriform.shapes.mesh import Mesh as Mesh
    from quadriform.shapes.model import DeformableModel as DeformableModel
    from quadriform.shapes.moving_model import MovingModel as MovingModel
    from quadriform.shapes.superquadric import Superquadric as Superquadric
    from quadriform.shapes.wall import wall_mesh as wall_mesh

__version__ = "0.1.0"

_HOME = {
    "ControlBox": "shapes.control_box",
    "DeformableModel": "shapes.model",
    "Fit": "fitting.result",
    "Labels": "imaging.selection",
    "Measures": "heart.measures_table",
    "Mesh": "shapes.mesh",
    "MovingModel": "shapes.moving_model",
    "Percentile": "imaging.selection",
    "Superquadric": "shapes.superquadric",
    "SuperquadricFit": "fitting.result",
    "Track": "motion.tracking",
    "Volume": "imaging.volume",
    "dice": "shapes.comparison",
    "fit": "imaging.fit_files",
    "fit_superquadric": "fitting.superquadric.fit",
    "load": "files",
    "measure": "heart.measure",
    "plot": "report.plot",
    "points_from_image": "imaging.image_points",
    "read_guide_point_frames": "files.guide_points",
    "read_guide_points": "files.guide_points",
    "read_points": "files",
    "read_volume": "imaging.reading",
    "refine": "fitting.fit",
    "save": "files",
    "segment": "imaging.segmentation",
    "show": "report.notebook",
    "surface_distances": "shapes.comparison",
    "to_pyvista": "report.exchange",
    "to_trimesh": "report.exchange",
    "track": "motion.tracking",
    "ventricle_from_labels": "imaging.ventricle",
    "ventricle_from_perfusion": "imaging.ventricle",
    "wall_mesh": "shapes.wall",
    "write_measures": "heart.measures_table",
}

__all__ = sorted([*_HOME, "examples"])


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"quadriform.{_HOME[name]}"), name)
    if name == "examples":
        return import_module("quadriform.examples")
    raise AttributeError(f"module 'quadriform' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__


_DISPLAYED = ("DeformableModel", "Fit", "MovingModel", "Track")


def _show_in_notebooks() -> None:
    """Register how a notebook displays models and fits; their own layers import no pictures."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    if shell is None:
        return
    formatter = shell.display_formatter.formatters["text/html"]
    for name in _DISPLAYED:
        formatter.for_type_by_name(
            f"quadriform.{_HOME[name]}", name, lambda value: import_module("quadriform.report.notebook").as_html(value)
        )


_show_in_notebooks()
