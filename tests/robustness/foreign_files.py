"""Every subcommand on files of other people: those in the wheels of nibabel, pydicom and scikit-image.

Each call must end with an exit code other than 70, and show no traceback and no Python warning. Fits are replaced by
what comes before them, the reading of the points. Run it with `make foreign`; a few of the files are among the tests.
"""

import contextlib
import importlib.util
import os
import shutil
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from unittest import mock

import quadriform as qf
from quadriform.cli import fit_run
from quadriform.cli.main import main
from quadriform.errors import InputError, QuadriformError
from quadriform.imaging.formats import image_format

FOLDERS = {
    "nibabel": (
        "tests/data",
        "nicom/tests/data",
        "gifti/tests/data",
        "freesurfer/tests/data",
        "streamlines/tests/data",
    ),
    "pydicom": ("data/test_files", "data/charset_files"),
    "skimage": ("data",),
}
"""Folders with test files, in each package."""
SIGNS = ("Traceback", "Warning:", "internal error", "Exception ignored")
"""What no user should read on a terminal."""


class NoFit(InputError):
    """Where a fit would begin."""


def wheel_files() -> list[Path]:
    """The test files in the installed wheels, and the folders of DICOM files among them."""
    paths: list[Path] = []
    for package, folders in FOLDERS.items():
        spec = importlib.util.find_spec(package)
        if spec is None or spec.origin is None:
            continue
        roots = [Path(spec.origin).parent / folder for folder in folders]
        inside = [path for root in roots if root.is_dir() for path in sorted(root.rglob("*"))]
        paths += [path for path in inside if "__pycache__" not in path.parts and path.suffix not in (".py", ".pyi")]
    return paths


def calls(path: Path, folder: Path) -> dict[str, Callable[[], int]]:
    """What is done with a file, by name; each returns an exit code."""
    mask = folder / "mask.nii.gz"
    return {
        "info": lambda: main(["info", str(path)]),
        "info --frame 0": lambda: main(["info", str(path), "--frame", "0", "--json"]),
        "segment": lambda: main(["segment", str(path), "-o", str(mask), "--force"]),
        "fit": lambda: main(["fit", str(path), "-o", str(folder / "fit")]),
        "read_volume": lambda: _python(lambda: qf.read_volume(path)),
        "read_points": lambda: _python(lambda: qf.read_points(path)),
        "load": lambda: _python(lambda: qf.load(path)),
    }


def faults(path: Path, folder: Path) -> dict[str, str]:
    """What goes wrong with a file: from the call to what was shown. Empty where nothing does.

    Args:
        path: the file or folder to read.
        folder: for outputs.
    """
    found = {}
    for name, call in calls(path, folder).items():
        code, shown = observed(call)
        if code == 70 or any(sign in shown for sign in SIGNS):
            found[name] = shown.strip() or f"exit code {code}"
    return found


def observed(call: Callable[[], int]) -> tuple[int, str]:
    """The exit code of a call, and all that it wrote to stderr, that of libraries too."""
    with tempfile.TemporaryFile() as file:
        with _stderr_to(file.fileno()), warnings.catch_warnings(), mock.patch.object(fit_run, "fit_sources", _no_fit):
            warnings.simplefilter("always")
            warnings.showwarning = _show
            with open(os.devnull, "w", encoding="utf-8") as sink, contextlib.redirect_stdout(sink):
                try:
                    code = call()
                except Exception as error:
                    print(f"Traceback: {type(error).__name__}: {error}", file=sys.stderr)
                    code = 70
        file.seek(0)
        return code, file.read().decode("utf-8", "replace")


def _show(message: object, category: type[Warning], filename: str, line: int, *_: object) -> None:
    print(f"{filename}:{line}: {category.__name__}: {message}", file=sys.stderr)


def _no_fit(*_: object, **__: object) -> None:
    raise NoFit("the points were read")


def _python(read: Callable[[], object]) -> int:
    try:
        read()
    except QuadriformError as error:
        return error.exit_code
    return 0


@contextlib.contextmanager
def _stderr_to(descriptor: int) -> Iterator[None]:
    """Python's stderr and that of compiled libraries, both into one file."""
    before = os.dup(2)
    os.dup2(descriptor, 2)
    stream = os.fdopen(os.dup(2), "w", encoding="utf-8", errors="backslashreplace", buffering=1)
    try:
        with contextlib.redirect_stderr(stream):
            yield
    finally:
        stream.close()
        os.dup2(before, 2)
        os.close(before)


def with_copies(paths: Sequence[Path], folder: Path) -> Iterator[Path]:
    """Files and folders, and of each DICOM file a copy in a folder of its own, where no neighbour speaks for it."""
    for number, path in enumerate(paths):
        yield path
        if path.is_file() and image_format(path) == "dicom":
            alone = folder / f"alone{number}"
            alone.mkdir()
            shutil.copy(path, alone)
            yield from (alone, alone / path.name)


def run(paths: Sequence[Path]) -> int:
    """Read all files in every way, print what goes wrong, and return how many calls did."""
    count: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["TMPDIR"] = folder
        tempfile.tempdir = None
        every = list(with_copies(paths, Path(folder)))
        for path in every:
            for name, shown in faults(path, Path(folder)).items():
                count[name] += 1
                print(f"{name} {path}: {shown[-600:]}")
    total = len(every) * len(calls(Path(), Path()))
    print(f"{sum(count.values())} of {total} calls on {len(every)} files: exit code 70, traceback or Python warning")
    return sum(count.values())


if __name__ == "__main__":
    sys.exit(1 if run([Path(word) for word in sys.argv[1:]] or wheel_files()) else 0)
