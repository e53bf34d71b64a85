"""Small inputs, and a way to call the terminal without leaving the process."""

from dataclasses import dataclass

import nibabel
import numpy as np
import pytest

from quadriform.cli.main import main
from quadriform.shapes.pose import rotation_from_euler

SEMI_AXES = np.array([30.0, 20.0, 12.0])
CENTRE = np.array([5.0, -7.0, 100.0])


@pytest.fixture(autouse=True)
def every_fit_once(remembered_fits):
    """The same fit of one cloud is asked for again and again."""


@dataclass
class Result:
    code: int
    out: str
    err: str


@pytest.fixture
def terminal(capsys, tmp_path, monkeypatch):
    """Call the terminal in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def call(*words):
        capsys.readouterr()
        code = main([str(word) for word in words])
        shown = capsys.readouterr()
        return Result(code, shown.out, shown.err)

    return call


@pytest.fixture
def ellipsoid():
    """400 points evenly on an oblique ellipsoid, (400, 3)."""
    n = np.arange(400) + 0.5
    z, turn = 1 - n / 200, n * np.pi * (1 + 5**0.5)
    flat = np.sqrt(1 - z**2)
    local = np.stack([flat * np.cos(turn), flat * np.sin(turn), z], axis=1) * SEMI_AXES
    return local @ rotation_from_euler(np.array([0.3, -0.5, 0.8])).T + CENTRE


@pytest.fixture
def cloud(tmp_path, ellipsoid):
    path = tmp_path / "cloud.xyz"
    np.savetxt(path, ellipsoid, fmt="%.17g")
    return path


@pytest.fixture
def affine():
    """Oblique, left-handed, with voxels of 2 x 2 x 3 mm; RAS as a file has it."""
    turn = np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]]) @ np.diag([-2.0, 2.0, 3.0])
    return np.block([[turn, np.array([[10.0], [20.0], [-30.0]])], [np.zeros((1, 3)), np.ones((1, 1))]])


@pytest.fixture
def body():
    """An ellipsoid of 1 in an image of 0, with a separate small block of 2."""
    grid = np.stack(np.meshgrid(*(np.arange(n) for n in (32, 26, 18)), indexing="ij"), axis=-1)
    inside = (((grid - [14, 13, 9]) / [12.0, 9, 6]) ** 2).sum(axis=-1) < 1
    image = inside.astype(np.int16)
    image[28:31, 20:24, 2:6] = 2
    return image


@pytest.fixture
def nifti(tmp_path, affine):
    def write(name, values):
        image = nibabel.Nifti1Image(values, affine)
        image.header.set_xyzt_units("mm")
        nibabel.save(image, tmp_path / name)
        return tmp_path / name

    return write
