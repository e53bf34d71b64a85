"""What can be drawn or handed to another library: triangles by name, in a known frame and unit."""

from dataclasses import dataclass

import numpy as np

from quadriform.errors import OptionError
from quadriform.fitting.result import Fit
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.moving_model import MovingModel

Drawable = DeformableModel | Fit | MovingModel | Mesh
FINEST = 512
"""Cells along an edge; 1.6 million vertices are more than any of these libraries draws with ease."""


@dataclass(frozen=True)
class Surfaces:
    """Triangles by the name of their surface.

    Attributes:
        meshes: name -> triangles.
        space: "LPS", "RAS" or "unknown".
        unit: "mm", "m" or "unknown".
        status: of the model's fit: "ok", "warned", "unreliable" or "unknown".
    """

    meshes: dict[str, Mesh]
    space: str = "unknown"
    unit: str = "unknown"
    status: str = "unknown"

    @property
    def only(self) -> Mesh:
        """The triangles of the model's only surface.

        Raises:
            OptionError: there are several.
        """
        if len(self.meshes) != 1:
            raise OptionError(f"surface: the model has {', '.join(map(repr, self.meshes))}; expected the name of one")
        return next(iter(self.meshes.values()))


def surfaces_of(drawable: Drawable, surface: str | None, time: float | None, resolution: int) -> Surfaces:
    """Triangles of all surfaces, or of one by its name.

    Args:
        drawable: a model, a fit, a moving model, or a mesh, which is taken as it is.
        surface: a name; None for all.
        time: of a moving model, in the unit of its knots.
        resolution: 1 to 512, as in `DeformableModel.mesh`.

    Raises:
        OptionError: nothing that has a surface, an unknown surface, a time too many or too few, no resolution.
    """
    # whole numbers of NumPy are no int
    if not isinstance(resolution, (int, np.integer)) or not 1 <= resolution <= FINEST:
        raise OptionError(f"option resolution={resolution!r}: expected a whole number from 1 to {FINEST}")
    if isinstance(drawable, Mesh):
        if surface is not None or time is not None:
            raise OptionError("a mesh has neither named surfaces nor times; leave out surface and time")
        return Surfaces({"surface": drawable})
    model = _model(drawable, time)
    names = model.surfaces if surface is None else [surface]
    meshes = {name: model.mesh(name, int(resolution)) for name in names}
    return Surfaces(meshes, model.space, model.unit, model.status)


def _model(drawable: Drawable, time: float | None) -> DeformableModel:
    if isinstance(drawable, MovingModel):
        if time is None:
            first, last = drawable.frame_times[[0, -1]]
            raise OptionError(f"option time: a moving model needs one; its frames go from {first:g} to {last:g}")
        return drawable.at(time)
    model = drawable.model if isinstance(drawable, Fit) else drawable
    if not isinstance(model, DeformableModel):
        found = type(drawable).__name__
        raise OptionError(f"expected a DeformableModel, a Fit, a MovingModel or a Mesh, found {found}")
    if time is not None:
        raise OptionError(f"option time={time!r}: {type(drawable).__name__} does not move; leave it out")
    return model
