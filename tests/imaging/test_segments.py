"""Segments chosen by name: DICOM segmentations, those of 3D Slicer, and label tables of NIfTI, made anew."""

import gzip

import nibabel
import numpy as np
import pydicom
import pytest
from dicom_made import write_segmentation
from numpy.testing import assert_allclose, assert_array_equal

from quadriform.errors import AffineError, FileFormatError, InputError, MaskError, OptionError
from quadriform.imaging.image_points import points_from_image
from quadriform.imaging.reading import frame_count, read_volume
from quadriform.imaging.segmentation import Labels, segment
from quadriform.imaging.segments import SegmentMap

SHAPE = (9, 8, 10)
SPACING, GAP = (1.5, 2.0), 3.0
ORIGIN = np.array([-10.0, 20.0, 5.0])


def box(i, j, k):
    mask = np.zeros(SHAPE, bool)
    mask[slice(*i), slice(*j), slice(*k)] = True
    return mask


LIVER, SPLEEN = box((1, 6), (1, 7), (0, 4)), box((2, 8), (2, 6), (4, 9))
INNER, OUTER = box((3, 6), (3, 6), (3, 7)), box((1, 8), (1, 7), (1, 9))
PAIRS = {"adjacent": {"liver": LIVER, "spleen": SPLEEN}, "nested": {"inner": INNER, "outer": OUTER}}


def mask_of(volume, *labels):
    return segment(volume, select=Labels(labels), component="all").mask


def slicer(path, masks, layered=True):
    """A .seg.nrrd as 3D Slicer writes it: overlapping segments in layers, all with the value 1."""
    names = []
    for n, name in enumerate(masks):
        value, layer = (1, n) if layered else (n + 1, 0)
        names.append(f"Segment{n}_Name:={name}\nSegment{n}_LabelValue:={value}\nSegment{n}_Layer:={layer}")
    stack = np.stack(list(masks.values())).astype(np.uint8)
    data = (
        stack if layered else (stack * np.arange(1, len(stack) + 1)[:, None, None, None]).max(axis=0).astype(np.uint8)
    )
    sizes = " ".join(map(str, data.shape))
    head = "list domain domain domain" if layered else "domain domain domain"
    vectors = f"({SPACING[0]},0,0) (0,{SPACING[1]},0) (0,0,{GAP})"
    text = (
        f"NRRD0004\ntype: unsigned char\ndimension: {data.ndim}\nspace: left-posterior-superior\nsizes: {sizes}\n"
        f"space directions: {'none ' if layered else ''}{vectors}\nkinds: {head}\nendian: little\nencoding: gzip\n"
        f"space origin: ({ORIGIN[0]},{ORIGIN[1]},{ORIGIN[2]})\n" + "\n".join(names) + "\n\n"
    )
    path.write_bytes(text.encode() + gzip.compress(data.tobytes(order="F")))
    return path


def dicom(path, masks, **options):
    write_segmentation(path, masks, ORIGIN, SPACING, GAP, **options)
    return path


WRITERS = {
    "dicom": lambda folder, masks: dicom(folder / "a.dcm", masks),
    "fractional": lambda folder, masks: dicom(folder / "a.dcm", masks, kind="FRACTIONAL"),
    "slicer": lambda folder, masks: slicer(folder / "a.seg.nrrd", masks),
}


@pytest.mark.parametrize("writer", WRITERS)
@pytest.mark.parametrize("pair", PAIRS)
def test_each_segment_is_found_by_name(tmp_path, writer, pair):
    path = WRITERS[writer](tmp_path, PAIRS[pair])
    volume = read_volume(path)
    lowest = min(int(np.nonzero(mask)[2].min()) for mask in PAIRS[pair].values()) if writer != "slicer" else 0
    if writer != "slicer":  # an empty slice at each end: the segments end there, and are not cut
        values = volume.values
        assert not values[..., 0].any() and not values[..., -1].any()
        assert_allclose(volume.points_world([[0, 0, 1]])[0], np.add(ORIGIN, [0, 0, GAP * lowest]), atol=1e-6)
        volume = volume.crop(((0, values.shape[0]), (0, values.shape[1]), (1, values.shape[2] - 1)))
    for name, mask in PAIRS[pair].items():
        found = mask_of(volume, name)
        assert_array_equal(found, mask[..., lowest : lowest + found.shape[2]])
        assert not mask[..., :lowest].any() and not mask[..., lowest + found.shape[2] :].any()
    first = volume.points_world([[0, 0, 0]])[0]
    assert_allclose(first, np.add(ORIGIN, [0, 0, GAP * lowest]), atol=1e-6)
    assert_allclose(volume.spacing, [*SPACING, GAP], atol=1e-6)
    both = np.logical_or(*PAIRS[pair].values()).sum()
    assert mask_of(volume, ",".join(PAIRS[pair])).sum() == mask_of(volume, "+".join(PAIRS[pair])).sum() == both
    assert frame_count(path) == 1


def test_numbers_are_those_of_the_file_also_where_segments_overlap(tmp_path):
    volume = read_volume(dicom(tmp_path / "a.dcm", PAIRS["nested"]))
    assert mask_of(volume, 1).sum() == INNER.sum() and mask_of(volume, 2).sum() == OUTER.sum()


def test_points_of_a_segment_by_name_record_the_name(tmp_path):
    volume = read_volume(dicom(tmp_path / "a.dcm", PAIRS["adjacent"]))
    found = points_from_image(volume, select=Labels(("liver",)))
    assert found.record["select"] == {"labels": ["liver"]}
    assert found.segmentation.mask.sum() == LIVER.sum() and found.warnings == {}


def test_one_layer_keeps_its_values(tmp_path):
    volume = read_volume(slicer(tmp_path / "a.seg.nrrd", PAIRS["adjacent"], layered=False))
    assert_array_equal(volume.values == 2, SPLEEN)
    assert_array_equal(mask_of(volume, "Liver"), LIVER)


def test_three_that_overlap_each_other():
    masks = {"a": box((0, 5), (0, 5), (0, 5)), "b": box((3, 8), (0, 5), (2, 7)), "c": box((2, 6), (2, 7), (1, 9))}
    found = SegmentMap(np.zeros(SHAPE, np.int32))
    for number, (name, mask) in enumerate(masks.items(), 1):
        found.add(name, number, mask)
    for one in found.segments:
        assert_array_equal(np.isin(found.values, one.values), masks[one.name])


@pytest.mark.parametrize(
    "label, said",
    [
        ("kidney", "no such segment; the image has the segments 1 'liver', 2 'spleen'"),
        ("liver,kidney", "'kidney': there is no such segment"),
    ],
)
def test_an_unknown_name_lists_the_segments(tmp_path, label, said):
    volume = read_volume(dicom(tmp_path / "a.dcm", PAIRS["adjacent"]))
    with pytest.raises(OptionError, match=said):
        mask_of(volume, label)


def test_what_is_ambiguous_is_refused(tmp_path):
    same = SegmentMap(np.zeros(SHAPE, np.int32))
    same.add("tumor", 1, LIVER)
    same.add("tumor", 1, SPLEEN)
    volume = read_volume(dicom(tmp_path / "a.dcm", PAIRS["adjacent"]))
    twice = type(volume)(same.values, volume.world_from_voxel, segments=tuple(same.segments))
    for label in ("tumor", 1):
        with pytest.raises(OptionError, match="2 segments have"):
            mask_of(twice, label)
    plain = type(volume)(same.values, volume.world_from_voxel)
    with pytest.raises(OptionError, match="names no segments"):
        mask_of(plain, "tumor")


def test_names_with_a_comma_are_names_first(tmp_path):
    volume = read_volume(slicer(tmp_path / "a.seg.nrrd", {"kidney, left": LIVER, "kidney": SPLEEN}))
    assert mask_of(volume, "kidney, left").sum() == LIVER.sum()


def test_a_label_table_of_nifti(tmp_path):
    values = (LIVER * 3 + SPLEEN * 7).astype(np.uint8)
    image = nibabel.Nifti1Image(values, np.eye(4))
    table = (
        b"<?xml version='1.0'?><CaretExtension><VolumeInformation Index='0'><LabelTable>"
        b"<Label Key='0' Red='1'><![CDATA[background]]></Label>"
        b"<Label Key='3' Red='1'><![CDATA[liver]]></Label><Label Key='7' Red='0'>spleen &amp; more</Label>"
        b"</LabelTable></VolumeInformation></CaretExtension>"
    )
    image.header.extensions.append(nibabel.nifti1.Nifti1Extension(0, table))
    nibabel.save(image, tmp_path / "a.nii.gz")
    volume = read_volume(tmp_path / "a.nii.gz")
    assert_array_equal(mask_of(volume, "liver"), LIVER)
    assert_array_equal(mask_of(volume, "spleen & more"), SPLEEN)
    assert len(volume.segments) == 2


def test_a_segment_without_voxels_is_named(tmp_path):
    volume = read_volume(dicom(tmp_path / "a.dcm", {"liver": LIVER, "empty": np.zeros(SHAPE, bool)}))
    for label in ("empty", 2):
        with pytest.raises(MaskError, match=f"the segment {label} has no voxels; .*1 'liver', 2 'empty'"):
            mask_of(volume, label)


def test_the_background_of_a_label_map_is_no_segment(tmp_path):
    """Its item has the number 0; what is left is one segment, and so is the object."""
    path = dicom(tmp_path / "a.dcm", {"liver": LIVER})
    header = pydicom.dcmread(path)
    header.SOPClassUID, header.SegmentationType = "1.2.840.10008.5.1.4.1.1.66.7", "LABELMAP"
    header.BitsAllocated = header.BitsStored = 8
    header.HighBit, images = 7, np.moveaxis(LIVER[..., :4], 2, 0).transpose(0, 2, 1)
    header.PixelData = images.astype(np.uint8).tobytes()
    background = pydicom.Dataset()
    background.SegmentNumber, background.SegmentLabel = 0, "Background"
    header.SegmentSequence = [background, *header.SegmentSequence]
    header.save_as(path)
    found = segment(read_volume(path))
    assert found.mask.sum() == LIVER.sum() and found.notes == ("the object is the segment 'liver'",)


class TestBadSegmentations:
    @pytest.mark.parametrize("number", [None, 1])
    def test_segments_without_a_number_of_their_own(self, tmp_path, number):
        path = dicom(tmp_path / "a.dcm", PAIRS["adjacent"])
        header = pydicom.dcmread(path)
        header.SegmentSequence[1].SegmentNumber = number
        header.save_as(path)
        with pytest.raises(FileFormatError, match="SegmentNumbers"):
            read_volume(path)

    def test_slices_off_the_grid(self, tmp_path):
        path = dicom(tmp_path / "a.dcm", PAIRS["adjacent"], shift={3: 1.0})
        with pytest.raises(AffineError, match="uneven slices"):
            read_volume(path)

    def test_a_frame_twice(self, tmp_path):
        path = dicom(tmp_path / "a.dcm", PAIRS["adjacent"], shift={1: -GAP})
        with pytest.raises(InputError, match="two frames of segment 1"):
            read_volume(path)

    def test_a_frame_of_no_segment(self, tmp_path):
        path = dicom(tmp_path / "a.dcm", PAIRS["adjacent"], numbers={0: 9})
        with pytest.raises(FileFormatError, match="frame 0 is of segment 9"):
            read_volume(path)

    def test_a_missing_layer(self, tmp_path):
        path = slicer(tmp_path / "a.seg.nrrd", PAIRS["adjacent"])
        path.write_bytes(path.read_bytes().replace(b"Segment1_Layer:=1", b"Segment1_Layer:=5"))
        with pytest.raises(FileFormatError, match="layer 5"):
            read_volume(path)


@pytest.mark.parametrize(
    "name, expected",
    [("seg_two_adjacent", {"liver": 7.216, "spleen": 2.854}), ("seg_two_nested", None)],
)
def test_the_cases_have_their_true_volumes(shared, name, expected):
    folder = shared / "cases" / "dicomseg" / name
    if not folder.is_dir():
        pytest.skip("this folder is not beside the repository")
    volume = read_volume(folder)
    voxel = abs(np.linalg.det(volume.world_from_voxel[:3, :3])) / 1000
    found = {one.name: mask_of(volume, one.name).sum() * voxel for one in volume.segments}
    assert len(found) == 2
    if expected:
        assert found == pytest.approx(expected, abs=1e-3)
    else:
        assert min(found.values()) < max(found.values())
