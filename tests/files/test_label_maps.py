"""A model on a grid of voxels."""

import nibabel
import numpy as np
import pytest

from quadriform.errors import FileFormatError, OptionError
from quadriform.files.label_maps import encode_label_map, label_map
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


def test_it_takes_the_grid_of_the_image_and_its_frame(tmp_path):
    affine = np.diag([-1.0, -1.0, 1.0, 1.0]) @ SKEW
    like = nibabel.Nifti1Image(np.zeros((38, 36, 32, 2), np.float32), affine)
    like.header.extensions.append(nibabel.nifti1.Nifti1Extension("comment", b"a name"))
    nibabel.save(like, tmp_path / "like.nii")
    (tmp_path / "labels.nii.gz").write_bytes(encode_label_map(model(), tmp_path / "like.nii"))
    found = nibabel.load(tmp_path / "labels.nii.gz")
    assert np.allclose(found.affine, affine, atol=1e-5) and not found.header.extensions
    assert np.mean(np.asarray(found.dataobj) != label_map(model(), (38, 36, 32), SKEW)) < 1e-4
    with pytest.raises(OptionError, match="unknown"):
        encode_label_map(model(unit="unknown"), tmp_path / "like.nii")
    (tmp_path / "bad.nii").write_bytes(b"no image")
    with pytest.raises(FileFormatError, match=r"bad\.nii"):
        encode_label_map(model(), tmp_path / "bad.nii")
