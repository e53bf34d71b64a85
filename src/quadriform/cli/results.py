"""Which files of a folder an earlier run wrote; none of them may be left beside new ones."""

import re
from pathlib import Path

from quadriform.cli.options import surface_file
from quadriform.cli.reporting import REPORT
from quadriform.errors import QuadriformError
from quadriform.files import load
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.moving_model import MovingModel

MODEL, FRAMES = "model.json", "frames.csv"
FRAME = re.compile(r"frame_[0-9]{3,}\.json")


def frame_model(number: int) -> str:
    """File name for the model of one frame, where each frame has its own."""
    return f"frame_{number:03d}.json"


def earlier_results(folder: Path) -> list[str]:
    """Names of the files of an earlier run in a folder, found by its models; empty without any."""
    if not folder.is_dir():
        return []
    models = [path.name for path in folder.iterdir() if path.name == MODEL or FRAME.fullmatch(path.name)]
    found: set[str] = set()
    for name in models:
        # a file of this name that is no model of ours is not ours to replace
        found |= {name, REPORT, *_beside(folder / name)} if _is_model(folder / name) else set()
    return sorted(name for name in found if (folder / name).exists())


def _is_model(path: Path) -> bool:
    try:
        return not isinstance(load(path), Mesh)
    except QuadriformError:
        return False


def _beside(path: Path) -> set[str]:
    """What `fit` or `track` wrote beside a model."""
    model = load(path)
    if isinstance(model, MovingModel) or path.name != MODEL:
        return {FRAMES}
    return set() if isinstance(model, Mesh) else {surface_file(name, ".ply") for name in model.surfaces}
