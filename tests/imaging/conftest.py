from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from quadriform.imaging.volume import Volume
from quadriform.points import Array

OBLIQUE = np.array(
    [[1.1, 0.3, -0.4, -12.0], [-0.5, 0.9, 0.2, 30.0], [0.3, -0.1, 2.4, 5.0], [0.0, 0.0, 0.0, 1.0]]
)  # rotated, sheared, spacings 1.24 x 0.95 x 2.44

SHAPE = (42, 46, 26)


@pytest.fixture
def oblique() -> Array:
    return OBLIQUE.copy()


@pytest.fixture
def ball() -> Callable[..., tuple[Volume, Array]]:
    """A ball voxelised on any grid: `ball(radius, affine=, shape=)` gives the signed height (mm) and the centre."""

    def make(radius: float, affine: Array = OBLIQUE, shape: tuple[int, ...] = SHAPE) -> tuple[Volume, Array]:
        at = np.moveaxis(np.indices(shape), 0, -1) @ affine[:3, :3].T + affine[:3, 3]
        centre = affine[:3, :3] @ ((np.array(shape) - 1) / 2 + [0.3, -0.2, 0.1]) + affine[:3, 3]
        return Volume(radius - np.linalg.norm(at - centre, axis=-1), affine), centre

    return make


@pytest.fixture
def save_nifti(tmp_path: Path) -> Callable[..., Path]:
    """Write an array as NIfTI; keywords are raw header fields, set after everything else."""

    def save(values: np.ndarray, affine: Array | None = None, name: str = "image.nii.gz", **fields: object) -> Path:
        import gzip

        from nibabel.nifti1 import Nifti1Header

        header = Nifti1Header(endianness=">" if values.dtype.byteorder == ">" else "<")
        header.set_data_shape(values.shape)
        header.set_data_dtype(values.dtype)
        header.set_sform(np.eye(4) if affine is None else affine, code=1)
        header.set_zooms([*np.linalg.norm(header.get_sform()[:3, :3], axis=0), 1, 1, 1, 1][: values.ndim])
        header.set_qform(None, code=0)
        header["magic"], header["vox_offset"], header["scl_slope"], header["scl_inter"] = b"n+1", 352, 1, 0
        header["xyzt_units"] = 2
        for field, value in fields.items():
            header[field] = value
        data = header.binaryblock + b"\0" * 4 + values.tobytes(order="F")
        path = tmp_path / name
        path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
        return path

    return save
