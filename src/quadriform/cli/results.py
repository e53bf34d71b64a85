"""Which files of a folder an earlier run wrote; none of them may be left beside new ones."""

import re
from pathlib import Path

from quadriform.cli.options import surface_file
from quadriform.cli.reporting import REPORT
from quadriform.errors import QuadriformError
from quadriform.files.models import read_any_model
from quadriform.shapes.moving_model import MovingModel

MODEL, FRAMES = "model.json", "frames.csv"
FRAME = re.compile(r"frame_[0-9]{3,}\.json")


def frame_model(number: int) -> str:
    """File name for the model of one frame, where each frame has its own."""
    return f"frame_{number:03d}.json"


def earlier_results(folder: Path) -> list[str]:
    """Names of the files of an earlier run in a folder, found by its models; empty without any."""
    files = list(folder.iterdir()) if folder.is_dir() else []
    models = [path for path in files if path.name == MODEL or FRAME.fullmatch(path.name)]
    found = {name for path in models for name in _written_with(path)}
    return sorted(name for name in found if (folder / name).exists())


def _written_with(path: Path) -> set[str]:
    """Names of a model and what `fit` or `track` wrote with it; empty for a file that is no model of ours."""
    try:
        model = read_any_model(path)
    except QuadriformError:
        return set()
    is_of_track = isinstance(model, MovingModel) or path.name != MODEL
    return {path.name, REPORT} | ({FRAMES} if is_of_track else {surface_file(name, ".ply") for name in model.surfaces})
