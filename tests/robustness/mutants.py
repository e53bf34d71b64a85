"""Each guard taken out in turn, in a copy: a test must fail. python tests/robustness/mutants.py (`make mutants`).

Prints the table of docs/reliability.md, one line a guard with the test that failed first; exits with 1 where none did.
"""

import contextlib
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from quadriform.shapes import _kernel

ROOT = Path(__file__).resolve().parents[2]
ALONE = """
import sys
sys.meta_path = [finder for finder in sys.meta_path if "ScikitBuild" not in type(finder).__name__]
"""
"""The installed package's own finder would lead away from the copy."""


ROOM = 4 << 30
"""Bytes for the data of one process: a list that grows without end must not take the memory of others."""


@dataclass(frozen=True)
class Mutant:
    """A guard, how it is taken out of a file of src/quadriform, and the tests that must notice."""

    guard: str
    file: str
    old: str
    new: str
    tests: str


MUTANTS = [
    Mutant(
        "points must be finite",
        "points.py",
        "if not (array.min() >= -LARGEST and array.max() <= LARGEST):",
        "if False:",
        "robustness/test_bad_inputs.py",
    ),
    Mutant(
        "centre before the fit",
        "points.py",
        "return (points - self.centre) / self.scale",
        "return points / self.scale",
        "robustness/test_bad_inputs.py",
    ),
    Mutant(
        "rank of the points", "points.py", "if distinct >= 4 and rank < 3", "if False", "robustness/test_bad_inputs.py"
    ),
    Mutant(
        "number of distinct points",
        "points.py",
        "if distinct < needed:\n        raise",
        "if False:\n        raise",
        "robustness/test_bad_inputs.py",
    ),
    Mutant("masked values", "points.py", "np.ma.getmaskarray(values).any()", "False", "robustness/test_bad_inputs.py"),
    Mutant("whole numbers above 2^53", "points.py", "> 2**53", "> 2**99", "robustness/test_bad_inputs.py"),
    Mutant(
        "digits that were lost",
        "point_sets.py",
        "if step / half <= least:",
        "if True:",
        "robustness/test_bad_inputs.py",
    ),
    Mutant(
        "edges at right angles",
        "shapes/control_box.py",
        "if not cosines.max() <= SKEW:",
        "if False:",
        "shapes/test_control_box.py",
    ),
    Mutant("names that are written alike", "points.py", "if text in result:", "if False:", "robustness/test_names.py"),
    Mutant(
        "copies count as weights",
        "fitting/cloud.py",
        "np.bincount(index, weights)",
        "np.bincount(index)",
        "fitting/test_duplicates.py",
    ),
    Mutant(
        "surface without data",
        "fitting/support.py",
        "supported, slices = distances <= limit,",
        "supported, slices = distances < np.inf,",
        "fitting/test_support.py",
    ),
    Mutant(
        "no logarithm of zero",
        "shapes/superellipse.py",
        "np.log(np.maximum(np.abs(u), TINY))",
        "np.log(np.abs(u))",
        "shapes",
    ),
    Mutant("flush to the disk", "files/atomic.py", "        os.fsync(stream.fileno())\n", "", "files/test_atomic.py"),
    Mutant(
        "replace at once",
        "files/atomic.py",
        "os.replace(temporary, target)",
        "shutil.copyfile(temporary, target)",
        "files/test_atomic.py",
    ),
    Mutant(
        "no trace of an interrupt",
        "files/atomic.py",
        "            os.unlink(temporary)\n",
        "            pass\n",
        "files/test_atomic.py",
    ),
    Mutant(
        "existing files stay",
        "files/atomic.py",
        "    if force:\n        return\n",
        "    return\n",
        "files/test_atomic.py",
    ),
    Mutant("budget of a file", "files/reading.py", "if size > MAX_BYTES:", "if False:", "files"),
    Mutant(
        "regular files only",
        "files/reading.py",
        "if not stat.S_ISREG(status.st_mode):",
        "if False:",
        "files/test_points.py",
    ),
    Mutant("bytes of a .npy", "files/arrays.py", "if declared != found:", "if False:", "files/test_points.py"),
    Mutant(
        "objects in a .npy",
        "files/arrays.py",
        'if not all(kind.kind in "biufcSU" for kind in _kinds(dtype)):',
        "if False:",
        "files/test_points.py",
    ),
    Mutant("names in an archive", "files/arrays.py", 'or ".." in path.parts', "", "files/test_points.py"),
    Mutant(
        "archives that swell",
        "files/arrays.py",
        "if declared > max(SMALL, MAX_EXPANSION * size):",
        "if False:",
        "files/test_points.py",
    ),
    Mutant(
        "bytes of a PLY",
        "files/ply.py",
        "if body[at:].strip():",
        "if False:",
        "files/test_meshes.py",
    ),
    Mutant(
        "whole lines of an OBJ",
        "files/obj.py",
        "if len(words) < 3 or not all(map(NUMBER.fullmatch, words)):",
        "if len(words) < 3:",
        "files/test_meshes.py",
    ),
    Mutant("no DTD in XML", "files/vtk_xml.py", 'b"<!DOCTYPE" in data or ', "", "files/test_meshes.py"),
    Mutant(
        "the end of a gzip stream",
        "imaging/nifti.py",
        "_skip(stream, reading.MAX_BYTES)\n    if missing > 0:\n        raise FileFormatError("
        'f"cut short: {missing} bytes of the {shape} voxels are missing")\n    if stream.read(1):',
        "_skip(stream, block * (shape[3] - frame.number - 1))\n    if missing > 0:\n        raise FileFormatError"
        '(f"{missing} cut short")\n    if False:',
        "imaging/test_reading.py",
    ),
    Mutant("voxels that are missing", "imaging/nifti.py", "if missing > 0:", "if False:", "imaging/test_reading.py"),
    Mutant(
        "compressed size of a MetaImage",
        "imaging/text_headers.py",
        "if header.stored not in (None, size - start):",
        "if False:",
        "imaging/test_simpleitk_images.py",
    ),
    Mutant(
        "lines of a MetaImage's header",
        "imaging/text_headers.py",
        "if not found or not key or not key.isprintable() or key in fields:",
        "if False:",
        "imaging/test_simpleitk_images.py",
    ),
    Mutant(
        "number of points in a text", "files/tables.py", "if declared != found:", "if False:", "files/test_points.py"
    ),
    Mutant(
        "shapes and numbers of a model",
        "files/packed.py",
        "if self.taken != len(self.values):",
        "if False:",
        "files/test_models.py",
    ),
    Mutant(
        "fields that no model has",
        "files/models.py",
        "root.only((*body, *record, *([LANDMARKS] if version >= landmarks_since else ())))",
        "pass",
        "files/test_models.py",
    ),
    Mutant(
        "texts of a page are escaped", "report/page.py", "autoescape=True", "autoescape=False", "report/test_reports.py"
    ),
    Mutant(
        "certificate of no folds",
        "fitting/refinement/unfolding.py",
        "return never_folds(box, surfaces.values()) and not DeformableModel(dict(surfaces), box).crossings()",
        "return True",
        "fitting/test_unfolding.py",
    ),
]


def noticed_by(mutant: Mutant, copy: Path, environment: dict[str, str]) -> str:
    """The first test that fails without the guard and not with it, empty where all pass."""
    path = copy / "src" / "quadriform" / mutant.file
    text = path.read_text(encoding="utf-8")
    if text.count(mutant.old) != 1:
        raise SystemExit(f"{mutant.guard}: {mutant.old!r} stands {text.count(mutant.old)} times in {mutant.file}")
    changed = text.replace(mutant.old, mutant.new)
    path.write_text("import shutil\n" + changed if "shutil." in mutant.new else changed, encoding="utf-8")
    try:
        done = tested(mutant.tests.split(), copy, environment)
    finally:
        path.write_text(text, encoding="utf-8")
    failed = re.search(r"^FAILED tests/([\w/.:]+)", done.stdout, re.MULTILINE)
    if done.returncode and (not failed or tested([failed[1]], copy, environment).returncode):
        raise SystemExit(f"{mutant.guard}: the tests fail by themselves:\n{done.stdout}")
    return failed[1] if failed else ""


def tested(
    names: Sequence[str], copy: Path, environment: dict[str, str], options: Sequence[str] = (), limit: int = 900
) -> subprocess.CompletedProcess[str]:
    """Tests of the copy, up to the first that fails; of each process so many seconds of the processor, and ROOM."""
    files = [f"tests/{name}" for name in names]
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *options, *files]

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 1))
        resource.setrlimit(resource.RLIMIT_DATA, (ROOM, ROOM))

    return subprocess.run(
        command, cwd=copy, env=environment, capture_output=True, encoding="utf-8", timeout=9 * limit, preexec_fn=limited
    )


@contextlib.contextmanager
def copied() -> Iterator[tuple[Path, dict[str, str]]]:
    """A copy of the project, and the environment in which its own code is imported."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "copy"
        left_out = shutil.ignore_patterns(".git", ".venv*", "out", "__pycache__", ".*_cache")
        shutil.copytree(ROOT, copy, ignore=left_out)
        shutil.copy(_kernel.__file__, copy / "src" / "quadriform" / "shapes")
        (copy / "alone").mkdir()
        (copy / "alone" / "sitecustomize.py").write_text(ALONE, encoding="utf-8")
        yield copy, os.environ | {"PYTHONPATH": os.pathsep.join([str(copy / "alone"), str(copy / "src")])}


def main() -> int:
    with copied() as (copy, environment):
        print("| guard | in | noticed by |\n| --- | --- | --- |")
        found = []
        for mutant in MUTANTS:
            found.append(noticed_by(mutant, copy, environment))
            print(f"| {mutant.guard} | `{mutant.file}` | {f'`{found[-1]}`' if found[-1] else 'NO TEST'} |", flush=True)
    return int(not all(found))


if __name__ == "__main__":
    sys.exit(main())
