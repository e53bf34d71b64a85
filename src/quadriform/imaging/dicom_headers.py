"""The image planes of a DICOM file from its header: classic slices, enhanced multi-frame, nuclear medicine.

References: DICOM PS3.3, C.7.6.2 (Image Plane), C.7.6.16 (Multi-frame Functional Groups), C.8.4.11 (NM Detector) and
C.8.4.15 (NM Reconstruction).
"""

from functools import partial
from pathlib import Path
from typing import Any

from quadriform.errors import AffineError, FileFormatError, MaskError
from quadriform.imaging import dicom_values
from quadriform.imaging.dicom_spacing import ImagePlane, pixel_steps, reconstructed_slice_step
from quadriform.imaging.dicom_values import Dataset, n_images, optional_number, required_numbers


def planes_of(header: Dataset, file: Path) -> list[ImagePlane]:
    """Return the planes of one file, in the order of its images.

    Raises:
        AffineError: positions, orientations or spacings are missing or unusable, or of several detectors; not one slice
            number and time slot for each image.
        MaskError: colour, or several energy windows or R-R intervals.
        FileFormatError: not one functional group for each image, or a rescaling that is no finite number.
    """
    if (samples := header.get("SamplesPerPixel", 1)) != 1:
        raise MaskError(f"expected one real number a pixel, found {samples}")
    if "PerFrameFunctionalGroupsSequence" in header:
        return _enhanced(header, file)
    if n_images(header) == 1:
        return [_classic(header, file)]
    if "DetectorInformationSequence" in header:
        return _nuclear(header, file)
    raise AffineError(
        f"{n_images(header)} images of modality {header.get('Modality')!r} and no position of each; expected "
        "functional groups or a reconstruction of nuclear medicine"
    )


def _classic(header: Dataset, file: Path) -> ImagePlane:
    return ImagePlane(
        required_numbers(header, "ImagePositionPatient", 3),
        *pixel_steps(header, header),
        **_pixels(header, header, file),
        trigger_time=optional_number(header, "TriggerTime"),
        acquisition_time=dicom_values.seconds_of_day(header.get("AcquisitionTime")),
        number=optional_number(header, "InstanceNumber"),
    )


def _enhanced(header: Dataset, file: Path) -> list[ImagePlane]:
    # C.7.6.16: one item for each image
    n, groups = n_images(header), len(header.PerFrameFunctionalGroupsSequence)
    if groups != n:
        raise FileFormatError(f"{n} images, but {groups} functional groups")
    planes = []
    for index in range(n):
        group = partial(dicom_values.functional_group, header, index)
        plane = ImagePlane(
            required_numbers(group("PlanePositionSequence"), "ImagePositionPatient", 3),
            *pixel_steps(group("PlaneOrientationSequence"), group("PixelMeasuresSequence")),
            **_pixels(header, group("PixelValueTransformationSequence"), file),
            index=index,
            alone=n == 1,
            trigger_time=optional_number(group("CardiacSynchronizationSequence"), "NominalCardiacTriggerDelayTime"),
            number=optional_number(group("FrameContentSequence"), "TemporalPositionIndex"),
        )
        planes.append(plane)
    return planes


def _nuclear(header: Dataset, file: Path) -> list[ImagePlane]:
    """Reconstructed slices: the detector has the position of the first, the others follow along the normal."""
    n = n_images(header)
    # C.8.4.9: images of several energy windows or R-R intervals are several volumes
    for vector in ("EnergyWindowVector", "RRIntervalVector"):
        if len(set(dicom_values.vector_of(header, vector, n, 1))) > 1:
            raise MaskError(f"{vector} has several values; expected one reconstruction")
    # C.8.4.9: SliceVector and TimeSlotVector number slices and time slots from 1
    slices = dicom_values.vector_of(header, "SliceVector", n)
    slots = dicom_values.vector_of(header, "TimeSlotVector", n, 1)
    located = [item for item in header.DetectorInformationSequence if "ImagePositionPatient" in item]
    detector, *others = located or [header]
    if others:
        raise AffineError(f"{len(others) + 1} detectors with ImagePositionPatient; expected one")
    along_row, along_column = pixel_steps(detector, header)
    step = reconstructed_slice_step(header, along_row, along_column)
    origin, slot_ms = required_numbers(detector, "ImagePositionPatient", 3), _slot_ms(header)
    return [
        ImagePlane(
            origin + (slices[index] - 1) * step,
            along_row,
            along_column,
            **_pixels(header, header, file),
            index=index,
            alone=False,
            trigger_time=None if slot_ms is None else (slots[index] - 1) * slot_ms,
            number=slots[index],
        )
        for index in range(n)
    ]


def _pixels(header: Dataset, values: Any, file: Path) -> dict[str, Any]:
    """Size, file, and the scale of the stored values (PS3.3, C.11.1), which an item of its own may have."""
    return {
        "size": (int(header.Columns), int(header.Rows)),
        "file": file,
        "rescale": (
            dicom_values.number_or_default(values, "RescaleSlope", 1.0),
            dicom_values.number_or_default(values, "RescaleIntercept", 0.0),
        ),
    }


def _slot_ms(header: Dataset) -> float | None:
    """Length of a time slot of a gated study, ms (FrameTime; PS3.3, C.8.4.12)."""
    for gated in header.get("GatedInformationSequence") or ():
        for data in gated.get("DataInformationSequence") or ():
            return optional_number(data, "FrameTime")
    return None
