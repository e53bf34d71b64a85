"""`quadriform demo`: a model of a real image that comes with a dependency."""

import time
from pathlib import Path
from typing import TYPE_CHECKING

from quadriform.cli.options import subcommand
from quadriform.cli.screen import emit_table, print_line, progress_bar, warn

if TYPE_CHECKING:
    from quadriform.fitting.result import Fit
    from quadriform.imaging.image_points import ImagePoints
    from quadriform.imaging.volume import Volume

SOURCE = "human brain, example4d.nii.gz of nibabel"
NAMES = ("model.json", "surface.ply", "slices.png", "report.html")


@subcommand
def demo(*, output: Path = Path("out/demo"), force: bool = False) -> None:
    """From the image of a brain to a model: segment, isosurface, fit, and a picture with the model's contours.

    The image is a slab that cuts the brain above and below; the cuts are closed on purpose, and the error is given
    with and without the points of these caps.

    Args:
        output: Folder for the results.
    """
    from quadriform.files.result_folder import check_results
    from quadriform.imaging.file_points import ReadOptions, Source
    from quadriform.imaging.fit_files import fit_sources
    from quadriform.imaging.image_points import points_from_image
    from quadriform.imaging.reading import example_path, example_volume
    from quadriform.point_sets import ALONE, PointSet

    check_results(output, NAMES, force)
    volume = example_volume()
    found = points_from_image(volume, select="otsu", closing=2, border="close")
    source = Source(PointSet(found.points), volume.space, volume.unit, found.warnings)
    begin = time.perf_counter()
    with progress_bar("fitting") as progress:
        files = {ALONE: (example_path(), ReadOptions())}
        result = fit_sources(files, {ALONE: source}, {"progress": progress})
    seconds = time.perf_counter() - begin
    warn(result.warnings)
    _write(result, found, volume, output, force)
    emit_table([*_rows(result, found), ("iterations, time", f"{result.iterations}, {seconds:.1f} s")], SOURCE)
    print_line(f"written to {output}: {', '.join(NAMES)}")


def _write(result: "Fit", found: "ImagePoints", volume: "Volume", output: Path, force: bool) -> None:
    from quadriform.files import save
    from quadriform.files.atomic import write_bytes
    from quadriform.files.result_folder import replaced_together
    from quadriform.point_sets import ALONE
    from quadriform.report.reports import fit_report
    from quadriform.report.slices import slices_png

    model = result.model
    shown = {
        "superquadric alone (11 parameters)": model.superquadric().mesh(48),
        f"model ({model.n_parameters} parameters)": model.mesh(resolution=48),
    }
    picture = slices_png(volume.values, volume.world_from_voxel, shown, SOURCE)
    report = fit_report(result, {ALONE: found.points}, title=SOURCE, record=found.record, image=volume)
    with replaced_together(output, NAMES[0], force) as folder:
        for name in NAMES[:2]:
            save(model, folder / name)
        for name, content in zip(NAMES[2:], (picture, report)):
            write_bytes(folder / name, content)


def _rows(result: "Fit", found: "ImagePoints") -> list[tuple[str, str]]:
    from quadriform.fitting.result import flat, rms

    # caps are no data: they only close the surface
    data, model = ~found.on_border, result.model
    error, alone = (rms(flat(values)[data]) for values in (result.residuals, result.superquadric_residuals))
    return [
        ("points", f"{len(found.points):,}, of them {int(found.on_border.sum()):,} on the caps"),
        ("parameters", f"{model.n_parameters}"),
        ("compression ratio", f"{result.compression_ratio:.1f}"),
        ("error RMS", f"{result.rms:.2f} mm; without the caps {error:.2f} mm"),
        ("superquadric alone", f"{result.superquadric_rms:.2f} mm; without the caps {alone:.2f} mm"),
        ("ratio of the two", f"{result.rms / result.superquadric_rms:.2f}"),
        ("volume, area", f"{model.volume() / 1000:.0f} ml, {model.area() / 100:.0f} cm2"),
    ]
