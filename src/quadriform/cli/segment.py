"""`quadriform segment`: the image front end alone."""

from pathlib import Path
from typing import Annotated

import typer

from quadriform.cli import options as shared


def segment(
    image: Annotated[
        Path, typer.Argument(help="An image: NIfTI, NRRD, MetaImage, DICOM, or a folder of DICOM slices.")
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="The mask, .nii, .nii.gz or .nrrd.")],
    label: shared.Label = None,
    threshold: shared.Threshold = None,
    region: shared.Region = None,
    seed: shared.Seed = None,
    closing: shared.Closing = None,
    fill_holes: shared.FillHoles = False,
    frame: shared.Frame = None,
    affine: shared.Affine = None,
    strict: shared.Strict = False,
    force: shared.Force = False,
    as_json: shared.Json = False,
) -> None:
    """Write the object of an image as a mask of 0 and 1 on the image's own grid."""
    from quadriform.cli.inputs import refuse
    from quadriform.cli.screen import emit_json, emit_table, say, warn
    from quadriform.errors import OptionError
    from quadriform.files.atomic import check_writable, write_bytes
    from quadriform.files.label_maps import LABEL_SUFFIXES, encode_labels
    from quadriform.files.reading import naming
    from quadriform.imaging.file_points import ImageOptions, kept_note, read_object
    from quadriform.imaging.segmentation import segment as segment_volume

    suffix = next((suffix for suffix in LABEL_SUFFIXES if output.name.lower().endswith(suffix)), None)
    if suffix is None:
        raise OptionError(f"option --output={str(output)!r}: a mask is written as {' or '.join(LABEL_SUFFIXES)}")
    options = ImageOptions.parse(label, threshold, region, seed, closing, fill_holes, None, frame, affine)
    check_writable(output, force, inputs=[image])
    with naming(image):
        volume, arguments, notes = read_object(image, options)
        found = segment_volume(volume, **arguments)
        if strict:
            refuse(found.warnings)
        content = encode_labels(found.mask.astype("uint8"), volume.world_from_voxel, volume.space, volume.unit, suffix)
    write_bytes(output, content, force)
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
