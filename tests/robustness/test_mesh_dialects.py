"""Every dialect of a mesh format is read as the body that it is, or refused by name with one line."""

import subprocess
import sys

import numpy as np
import pytest
from mesh_dialects import AREA, OTHER_FORMATS, POLYGONS, READ, REFUSED, VERTICES, VOLUME

from quadriform.cli.main import main
from quadriform.errors import FileFormatError, PointsError, QuadriformError
from quadriform.files import read_mesh, read_points
from quadriform.shapes.comparison import is_closed

GOOD = [(suffix, name, content) for suffix, made in READ.items() for name, content in made()]
BAD = [(suffix, name, content) for suffix, made in REFUSED.items() for name, content in made()]


def by_suffix(cases):
    suffixes = dict.fromkeys(suffix for suffix, _, _ in cases)
    return [pytest.param([case for case in cases if case[0] == suffix], id=suffix) for suffix in suffixes]


def test_there_are_dialects_of_every_format():
    from quadriform.files.meshes import READ_SUFFIXES

    assert set(READ) == set(REFUSED) == set(READ_SUFFIXES)
    assert len(GOOD) > 180 and len(BAD) > 60


@pytest.mark.parametrize("cases", by_suffix(GOOD))
def test_a_dialect_is_read_as_the_body_that_it_is(tmp_path, cases):
    for suffix, name, content in cases:
        path = tmp_path / f"body{suffix}"
        path.write_bytes(content)
        mesh = read_mesh(path)
        assert mesh.area() == pytest.approx(AREA, rel=1e-5), name
        assert mesh.volume() == pytest.approx(VOLUME, rel=1e-5), name
        assert is_closed(mesh), name
        assert len(mesh.faces) == sum(len(polygon) - 2 for polygon in POLYGONS), name
        points = np.unique(np.round(read_points(path), 4), axis=0)
        assert np.array_equal(points, np.unique(VERTICES, axis=0)), name


@pytest.mark.parametrize("cases", by_suffix(BAD))
def test_what_cannot_be_read_is_refused_with_the_name_of_the_file(tmp_path, cases):
    for suffix, name, content in cases:
        path = tmp_path / f"body{suffix}"
        path.write_bytes(content)
        with pytest.raises((FileFormatError, PointsError), match=f"body{suffix}'"):
            read_mesh(path)
            pytest.fail(f"{suffix}: {name} was read")


@pytest.mark.parametrize("cases", by_suffix(GOOD[::4] + BAD))
def test_the_terminal_shows_a_table_or_one_line(tmp_path, monkeypatch, capsys, cases):
    """No internal error (70), no traceback; a Python warning would be an error here. Of those that are read, a part."""
    monkeypatch.chdir(tmp_path)
    good = {(suffix, name) for suffix, name, _ in GOOD}
    for suffix, name, content in cases:
        (tmp_path / f"body{suffix}").write_bytes(content)
        code, shown = main(["info", f"body{suffix}"]), capsys.readouterr()
        if (suffix, name) in good:
            assert (code, shown.err) == (0, ""), name
        else:
            assert code == 4 and len(shown.err.splitlines()) == 1, name


def test_nothing_but_our_own_words_reaches_the_screen_of_a_process(tmp_path):
    """In a process of its own, where the loggers of libraries and Python's warnings would write to the screen."""
    files = []
    for number, (suffix, _, content) in enumerate([*GOOD[::7], *BAD[::3]]):
        files.append(f"{number}{suffix}")
        (tmp_path / files[-1]).write_bytes(content)
    script = "import sys\nfrom quadriform.cli.main import main\nfor name in sys.argv[1:]: main(['info', name])"
    done = subprocess.run([sys.executable, "-W", "always", "-c", script, *files], cwd=tmp_path, capture_output=True)
    lines = done.stderr.decode("utf-8", "replace").splitlines()
    assert done.returncode == 0 and lines
    assert all(line.startswith("quadriform: ") for line in lines), lines


@pytest.mark.parametrize("suffix", OTHER_FORMATS)
def test_other_formats_are_refused_by_name(tmp_path, suffix):
    path = tmp_path / f"body{suffix}"
    path.write_bytes(b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")
    with pytest.raises(QuadriformError, match=rf"cannot have the suffix '\{suffix}'; expected"):
        read_mesh(path)
    assert main(["fit", str(path), "-o", str(tmp_path / "out")]) == 4


def test_lz4_as_vtk_writes_it(tmp_path):
    block = pytest.importorskip("lz4.block", reason="the package lz4 is not installed")
    from mesh_dialects import PACKERS, Vtp

    PACKERS["vtkLZ4DataCompressor"] = lambda raw: block.compress(raw, store_size=False)
    file = Vtp("raw", compressor="vtkLZ4DataCompressor")
    content = file.file(file.piece(VERTICES, POLYGONS))
    (tmp_path / "body.vtp").write_bytes(content)
    assert read_mesh(tmp_path / "body.vtp").volume() == pytest.approx(VOLUME)
    (tmp_path / "body.vtp").write_bytes(content.replace(b"\x78", b"\x79"))
    del PACKERS["vtkLZ4DataCompressor"]


def test_lz4_that_is_not_installed_is_named(tmp_path, monkeypatch):
    from mesh_dialects import Vtp

    monkeypatch.setitem(sys.modules, "lz4", None)
    file = Vtp("binary", compressor="vtkZLibDataCompressor")
    content = file.file(file.piece(VERTICES, POLYGONS)).replace(b"ZLib", b"LZ4")
    (tmp_path / "body.vtp").write_bytes(content)
    with pytest.raises(FileFormatError, match=r"LZ4.*save it with zlib"):
        read_mesh(tmp_path / "body.vtp")
