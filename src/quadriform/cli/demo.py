"""`quadriform demo`: the main job on a real image that comes with a dependency."""

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from quadriform.cli import options as shared

if TYPE_CHECKING:
    from quadriform.errors import Warnings
    from quadriform.fitting.result import Fit

SOURCE = "human brain, example4d.nii.gz of nibabel"


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path("out/demo"),
    force: shared.Force = False,
) -> None:
    """From the image of a brain to a model: segment, isosurface, fit, and a picture with the model's contours.

    The image is a slab that cuts the brain above and below; the cuts are closed on purpose, and the error is given
    with and without the points of these caps.
    """
    from quadriform.cli.screen import emit_table, progress_bar, say, warn
    from quadriform.files import save
    from quadriform.files.atomic import write_bytes
    from quadriform.files.result_folder import check_results, replaced_together
    from quadriform.fitting.fit import fit
    from quadriform.fitting.inputs import ALONE
    from quadriform.fitting.result import rms
    from quadriform.imaging.image_points import points_from_image
    from quadriform.imaging.reading import example_volume
    from quadriform.report.reports import fit_report
    from quadriform.report.slices import slices_png

    names = ("model.json", "surface.ply", "slices.png", "report.html")
    check_results(output, names, force)
    volume = example_volume()
    found = points_from_image(volume, select="otsu", closing=2, border="close")
    warn(found.warnings)
    begin = time.perf_counter()
    with progress_bar("fitting") as progress:
        result = fit(found.points, progress=progress)
    seconds = time.perf_counter() - begin
    warn(result.warnings)
    marked = _marked(result, volume.space, volume.unit, found.warnings)
    model = marked.model

    mesh, before = model.mesh(resolution=48), model.superquadric().mesh(48)
    shown = {"superquadric alone (11 numbers)": before, f"model ({model.n_parameters} numbers)": mesh}
    picture = slices_png(volume.values, volume.world_from_voxel, shown, SOURCE)
    report = fit_report(marked, {ALONE: found.points}, title=SOURCE, record=found.record, image=volume)
    with replaced_together(output, names[0], force) as folder:
        save(model, folder / "model.json")
        save(model, folder / "surface.ply")
        write_bytes(folder / "slices.png", picture)
        write_bytes(folder / "report.html", report)

    data = ~found.on_border
    residuals, alone = result.residuals, result.superquadric_residuals
    rows = [
        ("points", f"{len(found.points):,}, of them {int(found.on_border.sum()):,} on the caps"),
        ("parameters", f"{model.n_parameters}"),
        ("compression ratio", f"{result.compression_ratio:.1f}"),
        ("error RMS", f"{result.rms:.2f} mm; without the caps {rms(residuals[data]):.2f} mm"),  # type: ignore[index]
        ("superquadric alone", f"{result.superquadric_rms:.2f} mm; without the caps {rms(alone[data]):.2f} mm"),  # type: ignore[index]
        ("ratio of the two", f"{result.rms / result.superquadric_rms:.2f}"),
        ("volume, area", f"{model.volume() / 1000:.0f} ml, {model.area() / 100:.0f} cm2"),
        ("iterations, time", f"{result.iterations}, {seconds:.1f} s"),
    ]
    emit_table(rows, SOURCE)
    say(f"written to {output}: {', '.join(names)}")


def _marked(result: "Fit", space: str, unit: str, warnings: "Warnings") -> "Fit":
    """The fit with the marks, the source and the warnings of its image."""
    from quadriform.errors import join_warnings
    from quadriform.files import sha256_of
    from quadriform.imaging.input_files import input_files
    from quadriform.imaging.reading import example_path

    file = example_path()
    record = replace(result.model.record, title=SOURCE, sources=input_files({"": [file]}))
    model = replace(result.model, space=space, unit=unit, input_sha256=sha256_of(file), record=record)
    return replace(result, model=model, warnings=join_warnings(warnings, result.warnings))
