"""A model on a grid of voxels."""

import nibabel
import numpy as np
import pytest
import SimpleITK

from quadriform.errors import InputError, OptionError
from quadriform.files.label_maps import LABEL_SUFFIXES, encode_labels, grid_of_model, label_map
from quadriform.imaging.reading import read_volume
from quadriform.shapes.control_box import ControlBox
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.superquadric import Superquadric

ENDO, EPI = Superquadric(semi_axes=(10, 8, 14), translation=(2, 1, 0)), Superquadric(semi_axes=(16, 15, 20))
SKEW = np.array([[1.1, 0.2, 0.1, -20.0], [-0.3, 0.9, 0.2, -16.0], [0.1, -0.2, -1.5, 24.0], [0, 0, 0, 1]])


def model(space="LPS", unit="mm"):
    return DeformableModel({"endo": ENDO, "epi": EPI}, ControlBox.around(EPI), space, unit)


def test_labels_are_those_of_the_implicit_functions():
    shape = (38, 36, 32)
    at = np.stack(np.indices(shape), axis=-1).reshape(-1, 3) @ SKEW[:3, :3].T + SKEW[:3, 3]
    inner, outer = (surface.implicit(at) for surface in (ENDO, EPI))
    expected = np.where(inner < 1, 1, np.where(outer < 1, 2, 0))
    sure = (np.abs(inner - 1) > 2e-3) & (np.abs(outer - 1) > 2e-3)
    assert np.array_equal(label_map(model(), shape, SKEW).ravel()[sure], expected[sure])
    assert {0, 1, 2} == set(expected[sure])


@pytest.mark.parametrize("suffix", LABEL_SUFFIXES)
@pytest.mark.parametrize("space", ["LPS", "RAS"])
def test_what_is_written_lies_where_its_grid_lies(tmp_path, suffix, space, rng):
    """A sheared, left-handed grid, read back by our reader and by an independent one."""
    values = rng.integers(0, 3, (7, 6, 5)).astype(np.uint8)
    path = tmp_path / f"labels{suffix}"
    path.write_bytes(encode_labels(values, SKEW, space, "mm", suffix))
    found = read_volume(path)
    in_lps = np.diag([1.0, 1, 1, 1] if space == "LPS" else [-1.0, -1, 1, 1]) @ SKEW
    assert np.array_equal(found.values, values)
    assert np.allclose(found.world_from_voxel, in_lps, atol=1e-5) and (found.space, found.unit) == ("LPS", "mm")
    if suffix == ".nrrd":
        image = SimpleITK.ReadImage(str(path))
        corner = image.TransformContinuousIndexToPhysicalPoint((6.0, 5.0, 4.0))
        assert np.allclose(corner, (in_lps @ [6, 5, 4, 1])[:3], atol=1e-4)
    else:
        assert np.allclose(nibabel.load(path).affine, np.diag([-1.0, -1, 1, 1]) @ in_lps, atol=1e-5)


def test_an_unknown_frame_stays_unknown(tmp_path):
    values = np.ones((3, 4, 5), np.uint8)
    (tmp_path / "a.nrrd").write_bytes(encode_labels(values, SKEW, "unknown", "mm", ".nrrd"))
    assert read_volume(tmp_path / "a.nrrd").space == "unknown"
    with pytest.raises(OptionError, match=r"write the mask as \.nrrd"):
        encode_labels(values, SKEW, "unknown", "mm")


def test_a_model_is_brought_to_the_frame_and_unit_of_the_grid():
    in_ras = np.diag([-1.0, -1.0, 1.0, 1.0]) @ SKEW
    metres = np.diag([1e-3, 1e-3, 1e-3, 1]) @ in_ras
    assert np.allclose(grid_of_model(model(), in_ras, "RAS", "mm"), SKEW)
    assert np.allclose(grid_of_model(model(), metres, "RAS", "m"), SKEW)
    assert np.allclose(grid_of_model(model(), in_ras, "RAS", "unknown"), SKEW)  # counts as mm
    with pytest.raises(OptionError, match="unknown"):
        grid_of_model(model(unit="unknown"), SKEW, "LPS", "mm")
    with pytest.raises(InputError):
        grid_of_model(model(), SKEW, "unknown", "mm")
