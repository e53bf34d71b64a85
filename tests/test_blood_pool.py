"""The blood pool by which a benchmark measures how well grey slices show a cavity."""

import sys
from pathlib import Path

import numpy as np
import pytest

from quadriform.errors import MaskError
from quadriform.imaging.reading import read_volume
from quadriform.imaging.volume import Volume

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))

from blood_pool import blood_pool


def test_blood_is_found_where_the_coil_fades_and_papillaries_stand():
    spacing, shape = np.array([1.5, 1.5, 4.0]), (40, 40, 16)
    at = np.moveaxis(np.indices(shape), 0, -1) * spacing - spacing * (np.array(shape) - 1) / 2
    cavity = ((at / (16, 15, 40)) ** 2).sum(axis=-1) < 1
    papillary = np.hypot(at[..., 0] - 15, at[..., 1]) < 4
    blood = np.where(cavity & ~papillary, 200.0, 30.0) * np.exp(-at[..., 2] / 20)
    volume, region = Volume(blood, np.diag([*spacing, 1.0])), ((2, 38), (2, 38), (4, 12))
    found = blood_pool(volume, (20, 20, 8), region)
    cavity[:, :, :4] = cavity[:, :, 12:] = False
    assert 2 * (found & cavity).sum() / (found.sum() + cavity.sum()) > 0.95
    with pytest.raises(MaskError, match="background"):
        blood_pool(volume, (3, 3, 8), region)


def test_the_real_blood_pool_is_the_label(shared):
    folder = shared / "data" / "pig_cine_mri"
    grey = read_volume(folder / "sax_cine_crop_4d.nii.gz", 0)
    label = read_volume(folder / "sax_lv_labels_crop_4d.nii.gz", 0).values[:, :, 1:14] == 1
    found = blood_pool(grey, (78, 72, 9), ((35, 122), (35, 112), (1, 14)))[:, :, 1:14]
    assert 2 * (found & label).sum() / (found.sum() + label.sum()) > 0.9
