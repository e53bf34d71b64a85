"""`quadriform track`: the frames of a cycle become one moving model."""

from pathlib import Path

from quadriform.cli.options import Common, check_space, subcommand
from quadriform.cli.track_options import FrameReading, Motion


@subcommand
def track(
    frames: list[Path],
    *,
    output: Path | None = None,
    reading: FrameReading,
    motion: Motion,
    space: str | None = None,
    common: Common,
) -> None:
    """Fit a moving model to the frames of a cycle: model.json, frames.csv, and a table of the results.

    Args:
        frames: One file a frame (points, meshes, images, contours GPFile_*.txt), a folder of them, or one 4-D image.
            Numbers in the names give the order in time; files without a common pattern are taken as given.
        output: Folder for the results. [default: INPUT-track]
    """
    from quadriform.cli.track_run import run

    run(frames, output, reading, motion, check_space(space), common)
