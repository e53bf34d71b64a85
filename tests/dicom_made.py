"""DICOM files made for tests: classic slices, enhanced multi-frame, gated nuclear medicine."""

import numpy as np
from pydicom.dataset import Dataset, FileMetaDataset
from pydicom.uid import ExplicitVRLittleEndian, generate_uid

NAME = "Secret^Patient"


def write_slice(path, values, position, along_row, along_column, spacing=(1.0, 1.0), series="1.2.3", **tags):
    """One image of (rows, columns) whole numbers; tags set to None are left out."""
    header = _header(values, series)
    header.SOPClassUID = "1.2.840.10008.5.1.4.1.1.4"
    header.ImagePositionPatient = [f"{x:.10g}" for x in position]
    header.ImageOrientationPatient = [f"{x:.10g}" for x in (*along_row, *along_column)]
    header.PixelSpacing = list(spacing)
    _finish(header, path, tags)


def write_enhanced(path, values, positions, along_row, along_column, spacing, triggers, slopes, **tags):
    """Images (n, rows, columns) in one file, each with a functional group."""
    header = _header(values, "1.2.4")
    header.SOPClassUID = "1.2.840.10008.5.1.4.1.1.4.1"
    header.NumberOfFrames = len(values)
    orientation = _of("PlaneOrientationSequence", ImageOrientationPatient=[*along_row, *along_column])
    measures = _of("PixelMeasuresSequence", PixelSpacing=list(spacing), SliceThickness=99)
    header.SharedFunctionalGroupsSequence = [_together(orientation, measures)]
    header.PerFrameFunctionalGroupsSequence = [
        _together(
            _of("PlanePositionSequence", ImagePositionPatient=list(position)),
            _of("CardiacSynchronizationSequence", NominalCardiacTriggerDelayTime=float(trigger)),
            _of("PixelValueTransformationSequence", RescaleSlope=slope, RescaleIntercept=1),
        )
        for position, trigger, slope in zip(positions, triggers, slopes)
    ]
    _finish(header, path, tags)


def write_nuclear(path, values, position, step, slices, slots, frame_ms=None, **tags):
    """Reconstructed slices (n, rows, columns) of 4 mm; their place is in the detector's sequence."""
    header = _header(values, "1.2.5")
    header.SOPClassUID = "1.2.840.10008.5.1.4.1.1.20"
    header.Modality = "NM"
    header.NumberOfFrames = len(values)
    header.PixelSpacing, header.SpacingBetweenSlices = [4, 4], step
    header.SliceVector, header.TimeSlotVector = list(slices), list(slots)
    detector = Dataset()
    detector.ImagePositionPatient, detector.ImageOrientationPatient = list(position), [1, 0, 0, 0, 1, 0]
    header.DetectorInformationSequence = [detector]
    if frame_ms is not None:
        header.GatedInformationSequence = [_of("DataInformationSequence", FrameTime=frame_ms)]
    _finish(header, path, tags)


def write_object(path, uid, series="1.2.9"):
    """An object of some class, without pixels."""
    header = Dataset()
    header.file_meta = FileMetaDataset()
    header.file_meta.TransferSyntaxUID, header.file_meta.MediaStorageSOPClassUID = ExplicitVRLittleEndian, uid
    header.PatientName, header.PatientID = NAME, NAME
    header.SOPClassUID, header.SOPInstanceUID = uid, generate_uid(entropy_srcs=["b"])
    header.SeriesInstanceUID = series
    header.save_as(path, enforce_file_format=True)


def write_segmentation(path, masks, origin, spacing, gap, kind="BINARY", shift=None, numbers=None):
    """Masks (columns, rows, slices) by name as segments; slices without a voxel are not stored, as most writers do.

    `shift` moves frames along the stack, and `numbers` gives frames another segment, by their index.
    """
    frames, positions, of = [], [], []
    for number, mask in enumerate(masks.values(), 1):
        for k in np.flatnonzero(mask.any(axis=(0, 1))):
            at = np.add(origin, [0, 0, gap * k + (shift or {}).get(len(frames), 0.0)])
            of.append((numbers or {}).get(len(frames), number))
            frames.append(mask[..., k].T)
            positions.append(at.tolist())
    images = np.stack(frames)
    header = _header(images.astype("<i2"), "1.2.6")
    header.SOPClassUID, header.Modality = "1.2.840.10008.5.1.4.1.1.66.4", "SEG"
    header.NumberOfFrames, header.PixelRepresentation, header.SegmentationType = len(images), 0, kind
    if kind == "FRACTIONAL":
        header.BitsAllocated = header.BitsStored = 8
        header.HighBit, header.MaximumFractionalValue = 7, 200
        header.PixelData = (images * np.uint8(180) + 10).astype(np.uint8).tobytes()
    else:
        header.BitsAllocated = header.BitsStored = 1
        header.HighBit = 0
        header.PixelData = np.packbits(images.ravel(), bitorder="little").tobytes()
    if len(header.PixelData) % 2:
        header.PixelData += b"\0"
    header.SegmentSequence = [_item(SegmentNumber=n, SegmentLabel=name) for n, name in enumerate(masks, 1)]
    orientation = _of("PlaneOrientationSequence", ImageOrientationPatient=[1, 0, 0, 0, 1, 0])
    measures = _of("PixelMeasuresSequence", PixelSpacing=list(spacing[::-1]), SliceThickness=99)
    header.SharedFunctionalGroupsSequence = [_together(orientation, measures)]
    header.PerFrameFunctionalGroupsSequence = [
        _together(
            _of("PlanePositionSequence", ImagePositionPatient=position),
            _of("SegmentIdentificationSequence", ReferencedSegmentNumber=number),
        )
        for position, number in zip(positions, of)
    ]
    _finish(header, path, {})


def _item(**content):
    item = Dataset()
    for keyword, value in content.items():
        setattr(item, keyword, value)
    return item


def _header(values, series):
    header = Dataset()
    header.file_meta = FileMetaDataset()
    header.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
    header.PatientName, header.PatientID = NAME, NAME
    header.SOPInstanceUID, header.SeriesInstanceUID, header.Modality = generate_uid(entropy_srcs=["a"]), series, "MR"
    header.Rows, header.Columns = values.shape[-2:]
    header.SamplesPerPixel, header.PhotometricInterpretation = 1, "MONOCHROME2"
    header.BitsAllocated = header.BitsStored = 16
    header.HighBit, header.PixelRepresentation = 15, 1
    header.PixelData = np.ascontiguousarray(values, dtype="<i2").tobytes()
    return header


def _finish(header, path, tags):
    for keyword, value in tags.items():
        if value is not None:
            setattr(header, keyword, value)
        elif keyword in header:
            delattr(header, keyword)
    header.save_as(path, enforce_file_format=True)


def _of(sequence, **content):
    """A dataset with one sequence of one item."""
    outer = Dataset()
    setattr(outer, sequence, [_item(**content)])
    return outer


def _together(*parts):
    whole = Dataset()
    for part in parts:
        whole.update(part)
    return whole
