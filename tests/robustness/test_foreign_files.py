"""A sample of the files in the wheels of other packages; `make foreign` takes them all."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from foreign_files import faults, observed, wheel_files

SAMPLE = (
    *(
        "DICOMDIR",
        "test-SR.dcm",
        "rtstruct.dcm",
        "rtplan_truncated.dcm",
        "waveform_ecg.dcm",
        "liver_1frame.dcm",
        "badVR.dcm",
    ),
    *("rtdose.dcm", "MR_truncated.dcm", "no_meta.dcm", "JPEG-lossy.dcm", "SC_rgb_small_odd.dcm", "README.txt", "CT5N"),
    *("analyze.hdr", "nifti1.hdr", "example_nifti2.nii.gz", "functional.nii", "standard.trk", "small.mnc", "ascii.gii"),
    *("multipage.tif", "motorcycle_disp.npz", "lfw_subset.npy", "moon.png"),
)


def test_files_of_other_people_end_in_a_result_or_a_typed_error(tmp_path):
    paths = [path for path in wheel_files() if path.name in SAMPLE]
    assert len({path.name for path in paths}) > 15
    assert {str(path): found for path in paths if (found := faults(path, tmp_path))} == {}


@pytest.mark.parametrize("words", ["internal error", "UserWarning: no", "Traceback (most recent call last)"])
def test_such_a_fault_is_seen(words):
    assert words in observed(lambda: print(words, file=sys.stderr) or 4)[1]


def test_a_python_warning_is_seen():
    def warn():
        import warnings

        warnings.warn("unheard", UserWarning, stacklevel=1)
        return 0

    assert "UserWarning: unheard" in observed(warn)[1]
