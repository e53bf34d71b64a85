"""`quadriform segment`: the image front end alone."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from quadriform.cli import options as shared

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def segment(
    image: Annotated[Path, typer.Argument(help="A NIfTI image.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="The mask, .nii or .nii.gz.")],
    label: shared.Label = None,
    threshold: shared.Threshold = None,
    region: shared.Region = None,
    seed: shared.Seed = None,
    closing: shared.Closing = None,
    fill_holes: shared.FillHoles = False,
    frame: shared.Frame = None,
    strict: shared.Strict = False,
    force: shared.Force = False,
    as_json: shared.Json = False,
) -> None:
    """Write the object of an image as a mask of 0 and 1 on the image's own grid."""
    from quadriform.cli.inputs import naming, refuse
    from quadriform.cli.screen import emit_json, emit_table, say, warn
    from quadriform.errors import OptionError
    from quadriform.files.atomic import check_writable, write_bytes
    from quadriform.imaging.segmentation import segment as segment_volume
    from quadriform.imaging.sources import NIFTI_SUFFIXES, ImageOptions, kept_note, read_object

    if not output.name.lower().endswith(NIFTI_SUFFIXES):
        raise OptionError(f"option --output={str(output)!r}: a mask is written as {' or '.join(NIFTI_SUFFIXES)}")
    options = ImageOptions.parse(label, threshold, region, seed, closing, fill_holes, None, frame)
    check_writable(output, force, inputs=[image])
    with naming(image):
        volume, arguments, notes = read_object(image, options)
        found = segment_volume(volume, **arguments)
        if strict:
            refuse(found.warnings)
    write_bytes(output, _encode(found.mask, image, output.name.lower().endswith(".gz")), force)
    notes += kept_note(found)
    for note in notes:
        say(f"note: {image}: {note}")
    warn(found.warnings)
    record = {
        "input": str(image),
        "output": str(output),
        "voxels": int(found.mask.sum()),
        "shape": list(found.mask.shape),
        "threshold": found.threshold,
        "components": len(found.component_voxels),
        "warnings": {str(kind): text for kind, text in found.warnings.items()},
        "notes": list(notes),
    }
    if as_json:
        emit_json(record)
    else:
        emit_table([(name, str(record[name])) for name in ("output", "voxels", "shape", "threshold", "components")])


def _encode(mask: "NDArray[np.bool_]", image: Path, compressed: bool) -> bytes:
    """A NIfTI file with the geometry of `image`, both forms and their codes, but none of its other contents."""
    import gzip

    import nibabel
    import numpy as np

    source: Any = nibabel.load(image)
    header = source.header.copy()
    header.set_data_dtype(np.uint8)
    header["cal_min"] = header["cal_max"] = 0  # a display window for grey values would hide the mask
    header.extensions.clear()  # may name the patient
    content: bytes = type(source)(mask.astype(np.uint8), source.affine, header).to_bytes()
    return gzip.compress(content, mtime=0) if compressed else content
