"""The choice of the transform from voxels to the world in a NIfTI header: sform, qform, or the voxel sizes alone.

A header has the voxel sizes twice: in `pixdim`, which the qform uses, and in the sform (nifti1.h, "methods" 1 to 3 of
the section on orientation). Where the two transforms disagree:

- in sizes: the qform is used, for `pixdim` supports it, with a warning that names both;
- in position or direction alone: the sform is used, as other readers do, with a warning that names both;
- in handedness, or by a shear of the sform: refused, for nothing in the header decides; the caller chooses.

A sform alone whose sizes are not those of `pixdim` is refused too.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from quadriform.errors import AffineError, OptionError, WarningKind, Warnings, choose
from quadriform.imaging.volume import affine_fault
from quadriform.points import Array
from quadriform.shapes.voxels import voxel_spacing

if TYPE_CHECKING:
    from nibabel.nifti1 import Nifti1Header

AFFINES = ("sform", "qform", "pixdim")
"""The values of the option `affine`; the last has sizes, and no position or direction in a known space."""
KNOWN_CODES = 5
"""The largest qform_code and sform_code of the standard: 0 for none, up to NIFTI_XFORM_TEMPLATE_OTHER."""
SAME_FORM = 0.01
"""Two forms agree when no corner of the image moves by more than this fraction of the smallest spacing."""
SAME_SIZE = 0.01
"""Sizes of voxels agree to this fraction; headers round."""


@dataclass(frozen=True)
class Forms:
    """The transforms of a header.

    Attributes:
        stored: from the name to the transform (4, 4), RAS from voxels; NaN where it cannot be computed.
        codes: of sform and qform; 0 for one that is not given.
        sizes: (3,) `pixdim`.
        shape: voxels along i, j, k.
    """

    stored: dict[str, Array]
    codes: dict[str, int]
    sizes: Array
    shape: tuple[int, ...]

    @property
    def given(self) -> list[str]:
        """Names of the forms with a code above 0."""
        return [name for name, code in self.codes.items() if code > 0]

    def described(self) -> str:
        """Return all forms, for a message."""
        return "; ".join(f"{name} (code {code}) {self.stored[name].tolist()}" for name, code in self.codes.items())

    def refusal(self, fault: str) -> AffineError:
        """Return the error with the forms of the header, and the option that chooses one."""
        usable = [name for name in (*self.given, "pixdim") if not affine_fault(self.stored[name])]
        choice = " or ".join(f"--affine {name} (affine={name!r})" for name in usable)
        advice = f"choose by {choice}" if usable else "repair the header, or build a Volume with your own transform"
        return AffineError(f"{fault}; {self.described()}; pixdim {_size(self.sizes)}; {advice}")


def read_forms(header: "Nifti1Header", shape: tuple[int, ...]) -> Forms:
    """Return the transforms of a header as they are stored, for an image of `shape` voxels.

    Raises:
        AffineError: codes that the standard does not have.
    """
    sizes = np.array(header["pixdim"][1:4], dtype=np.float64)
    stored = {"sform": header.get_sform(), "qform": _qform(header), "pixdim": np.diag([*sizes, 1.0])}
    codes = {name: int(header[f"{name}_code"]) for name in ("sform", "qform")}
    if not all(0 <= code <= KNOWN_CODES for code in codes.values()):
        raise AffineError(f"form codes {codes}; expected 0 to {KNOWN_CODES}: the header is damaged")
    return Forms(stored, codes, sizes, shape[:3])


def choose_form(forms: Forms, requested: str | None) -> tuple[str, Warnings]:
    """Return the name of the transform to use, and AFFINE_REPAIRED where two of them disagree.

    Args:
        forms: of the header.
        requested: one of AFFINES, or None to decide by the rules of this module.

    Raises:
        AffineError: none can be used, or they disagree and nothing decides.
        OptionError: `requested` is unknown, or the header has no such transform.
    """
    if requested is not None:
        return _requested(forms, choose(requested, AFFINES, "affine")), {}
    if not forms.given:
        raise forms.refusal("no usable transform to the world: no form has a code above 0")
    first = forms.given[0]
    if fault := affine_fault(forms.stored[first]):
        raise forms.refusal(f"no usable transform to the world ({first}: {fault})")
    if first == "qform":
        return first, {}
    fault = affine_fault(forms.stored["qform"])
    if "qform" not in forms.given or fault:
        if not _same_sizes(forms):
            raise forms.refusal(f"sform has voxels of {_size(voxel_spacing(forms.stored['sform']))}, pixdim has others")
        text = f"the qform is unusable ({fault}); the sform is used"
        return first, {WarningKind.AFFINE_REPAIRED: text} if "qform" in forms.given else {}
    return _sform_or_qform(forms)


def _requested(forms: Forms, name: str) -> str:
    if name in forms.codes and name not in forms.given:
        raise OptionError(f"option affine={name!r}: the header has no {name} (code 0); {forms.described()}")
    if fault := affine_fault(forms.stored[name]) or ("" if (forms.sizes > 0).all() else "pixdim has no sizes"):
        raise AffineError(f"affine={name!r} cannot be used: {fault}; {forms.described()}")
    return name


def _sform_or_qform(forms: Forms) -> tuple[str, Warnings]:
    """sform or qform, both given and usable."""
    sform, qform = forms.stored["sform"], forms.stored["qform"]
    distance = _corner_distance(forms)
    if distance <= SAME_FORM * voxel_spacing(sform).min():
        return "sform", {}
    volumes = np.linalg.det(sform[:3, :3]), np.linalg.det(qform[:3, :3])
    if volumes[0] * volumes[1] < 0:
        raise forms.refusal("sform and qform are mirror images of each other: left and right are exchanged in one")
    both = (
        f"sform (code {forms.codes['sform']}, voxels of {_size(voxel_spacing(sform))}) and qform (code "
        f"{forms.codes['qform']}, {_size(voxel_spacing(qform))}) disagree: they put a corner of the image "
        f"{distance:.4g} (in the unit of the file) apart and differ by {_degrees(sform, qform):.3g} degrees"
    )
    if not _same_sizes(forms):
        return "qform", {
            WarningKind.AFFINE_REPAIRED: f"{both}; pixdim {_size(forms.sizes)} supports the qform, which is used; "
            "--affine sform (affine='sform') takes the other"
        }
    if abs(volumes[0] / volumes[1] - 1) > SAME_SIZE:
        raise forms.refusal(f"{both}, and the sform is sheared")
    return "sform", {
        WarningKind.AFFINE_REPAIRED: f"{both}; voxels are equal in size, and the sform is used, as other readers do; "
        "--affine qform (affine='qform') takes the other"
    }


def _same_sizes(forms: Forms) -> bool:
    """Whether the sform's voxels are those of `pixdim`; a `pixdim` without sizes contradicts nothing."""
    sizes = forms.sizes
    if not (np.isfinite(sizes).all() and (sizes > 0).all()):
        return True
    return bool((np.abs(voxel_spacing(forms.stored["sform"]) / sizes - 1) <= SAME_SIZE).all())


def _corner_distance(forms: Forms) -> float:
    """The largest distance of a corner of the image by the sform from the same corner by the qform."""
    # the difference of affine transforms is largest at a corner
    corners = np.array([(*corner, 1) for corner in np.ndindex(2, 2, 2)]) * (*np.array(forms.shape) - 1, 1)
    return float(np.linalg.norm(corners @ (forms.stored["sform"] - forms.stored["qform"]).T, axis=1).max())


def _degrees(one: Array, other: Array) -> float:
    cosines = (one[:3, :3] * other[:3, :3]).sum(axis=0) / (voxel_spacing(one) * voxel_spacing(other))
    return float(np.degrees(np.arccos(np.clip(cosines, -1, 1))).max())


def _size(sizes: Array) -> str:
    return " x ".join(f"{size:.4g}" for size in sizes)


def _qform(header: "Nifti1Header") -> Array:
    """The qform as stored, NaN where it cannot be computed."""
    from nibabel.spatialimages import HeaderDataError

    header = header.copy()
    if header["pixdim"][0] == 0:
        header["pixdim"][0] = 1  # nifti1.h: qfac, the sign of the third axis, is 1 where pixdim[0] is 0
    try:
        return header.get_qform()
    except (HeaderDataError, ValueError):
        return np.full((4, 4), np.nan)
