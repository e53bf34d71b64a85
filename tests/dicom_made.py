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
    item, outer = Dataset(), Dataset()
    for keyword, value in content.items():
        setattr(item, keyword, value)
    setattr(outer, sequence, [item])
    return outer


def _together(*parts):
    whole = Dataset()
    for part in parts:
        whole.update(part)
    return whole
