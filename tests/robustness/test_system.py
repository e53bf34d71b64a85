"""Rows 66 to 77 of docs/reliability.md: disks, signals, locales, threads and processes; all of it in real processes."""

import json
import os
import runpy
import shutil
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from shapes_made import lumpy

import quadriform as qf
from quadriform.cli.main import main
from quadriform.files.atomic import write_bytes
from quadriform.points import Frame
from quadriform.shapes import threads

CLOUD = lumpy(100)
WITH_TESTS = os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
OLD, NEW = b"0" * 500_000, b"1" * 700_000
WRITER = (
    "import sys; from quadriform.files.atomic import write_bytes\n"
    "print('go', flush=True)\n"
    "for _ in range(int(sys.argv[2])):\n"
    "    for data in (b'1' * 700_000, b'0' * 500_000): write_bytes(sys.argv[1], data, True)\n"
)
STOPPED = """
import json, os, random, sys, time
from pathlib import Path
from quadriform.files.atomic import write_bytes
path, instants, seen = Path(sys.argv[1]), random.Random(69), []
old, new = b"0" * 500_000, b"1" * 700_000
began = time.monotonic()
for data in (new, old):
    write_bytes(path, data, True)
both = time.monotonic() - began
for turn in range(50):
    path.write_bytes(old)
    child = os.fork()
    while not child:
        write_bytes(path, new, True)
        write_bytes(path, old, True)
    time.sleep(instants.uniform(0, 2 * both))
    done, waited = 0, 0
    while not done:  # Python loses an interrupt that falls into a finaliser: after a second it is sent again
        if waited % 200 == 0:
            os.kill(child, (9, 15, 2)[turn % 3])
        time.sleep(0.005)
        done, status = os.waitpid(child, os.WNOHANG)
        waited += 1
    content = path.read_bytes()
    strays = [each for each in path.parent.iterdir() if each != path]
    ended = os.waitstatus_to_exitcode(status)
    seen.append((ended, {old: "old", new: "new"}.get(content, "neither"), [each.name for each in strays]))
    for each in strays:
        each.unlink()
print(json.dumps(seen))
"""
LIMITED = (
    "import json, resource, signal, sys\n"
    "from types import SimpleNamespace\n"
    "from undrawn import draw_nothing\n"
    "draw_nothing(SimpleNamespace(setattr=setattr))\n"
    "sys.dont_write_bytecode = True\n"  # Python would keep byte code cut off at the limit, and fail on it ever after
    "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
    "from quadriform.cli.main import main\n"
    "for limit, words in json.loads(sys.argv[1]):\n"
    "    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))\n"
    "    print(main(words))\n"
)
WITH_COMMAS = (
    "import locale, sys\n"
    "locale.setlocale(locale.LC_ALL, '')\n"
    "if locale.format_string('%.1f', 1.5) != '1,5': sys.exit('this locale has no commas')\n"
)
SEVERAL = (
    "import json, sys\n"
    "from quadriform.cli.main import main\n"
    "sys.exit(max(main(words) for words in json.loads(sys.argv[1])))\n"
)
FIT = (
    "import sys, numpy as np, quadriform as qf\n"
    "from quadriform.shapes import threads\n"
    "threads.WORTH = 100\n"
    "fit = qf.fit(np.load(sys.argv[1]), box=(2, 2, 2))\n"
    "np.save(sys.argv[2], fit.model.mesh(resolution=8).vertices)\n"
)


def python(*words, **environment):
    return subprocess.run(
        [sys.executable, *map(str, words)], capture_output=True, encoding="utf-8", env=os.environ | environment
    )


def quadriform(*words, **environment):
    return python("-m", "quadriform.cli.main", *words, **environment)


def commanded(program, lines, **environment):
    """A process in which a program is given the words of several commands."""
    return python("-c", program, json.dumps([list(map(str, words)) for words in lines]), **environment)


@pytest.fixture
def cloud(tmp_path):
    np.savetxt(tmp_path / "cloud.xyz", CLOUD, fmt="%.17g")
    return tmp_path / "cloud.xyz"


@pytest.fixture
def saved(cloud, tmp_path):
    """A model, and what was exported of it before."""
    qf.save(qf.fit(CLOUD, box=(3, 3, 3), strength=1e-4).model, tmp_path / "model.json")
    (tmp_path / "surfaces").mkdir()
    (tmp_path / "surfaces" / "surface.ply").write_bytes(b"old")
    return tmp_path / "model.json"


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_row_68_what_does_not_fit_on_the_disk_leaves_the_old_files(saved, cloud, tmp_path, blank_figures):
    """As on a full disk: the system refuses the write itself.

    Of the results of a fit none fits, or the model, or model and surface but not the page; and a single file does not.
    """
    fit = ["fit", str(cloud), "-o", str(tmp_path / "out"), "--box", "3,3,3", "--method", "paper", "--iterations", "1"]
    assert main(fit) == 0
    before = contents(tmp_path / "out")
    sizes = sorted(map(len, before.values()))
    limits = [1000, *((less + more) // 2 for less, more in pairwise(sizes))]
    np.savetxt(cloud, lumpy(100, seed=5), fmt="%.17g")
    export = ["export", str(saved), "--to", "ply", "-o", str(tmp_path / "surfaces"), "--force"]
    tries = [(1000, export), *((limit, [*fit, "--force"]) for limit in limits)]
    done = python("-c", LIMITED, json.dumps(tries), PYTHONPATH=WITH_TESTS)
    assert done.stdout.split() == ["5"] * 4
    lines = done.stderr.splitlines()
    assert len(lines) == 4 and all("writing failed, nothing was changed" in line for line in lines)
    assert contents(tmp_path / "surfaces") == {"surface.ply": b"old"}
    assert contents(tmp_path / "out") == before


def test_row_69_stopped_at_fifty_instants(tmp_path):
    """The target is the old file or the new one, whole; all that may be left is the temporary file of a killed one."""
    done = python("-c", STOPPED, tmp_path / "a")
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    assert [ended for ended, _, _ in seen] == [-(9, 15, 2)[turn % 3] for turn in range(50)]
    assert {content for _, content, _ in seen} == {"old", "new"}
    for ended, _, strays in seen:
        assert all(name.startswith(".quadriform-") and name.endswith(".tmp") for name in strays)
        assert ended != -signal.SIGINT or not strays
    write_bytes(tmp_path / "a", b"next", force=True)
    assert (tmp_path / "a").read_bytes() == b"next"


def test_row_69_whole_fits_that_are_stopped():
    """Three of them, a signal each, by a seed that sees files written in place; fifty by `make kill`."""
    done = python(Path(__file__).with_name("killed_fits.py"), 3, 1, PYTHONPATH=WITH_TESTS)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == "3 of 3 as promised"


def test_row_70_two_writers_of_one_file(tmp_path):
    """Each 60 times; whoever reads meanwhile sees one of the two files, whole."""
    path, seen = tmp_path / "a", set()
    path.write_bytes(OLD)
    children = [
        subprocess.Popen([sys.executable, "-c", WRITER, str(path), "30"], stdout=subprocess.DEVNULL) for _ in "12"
    ]
    while any(child.poll() is None for child in children):
        seen.add({OLD: "old", NEW: "new"}.get(path.read_bytes(), "torn"))
    assert [child.returncode for child in children] == [0, 0]
    assert seen == {"old", "new"}
    assert os.listdir(tmp_path) == ["a"]


@pytest.fixture(scope="module")
def german(tmp_path_factory):
    """Environment of a terminal that writes commas; few machines have such a locale, so it is made."""
    maker, folder = shutil.which("localedef"), tmp_path_factory.mktemp("locales")
    if maker is None:
        pytest.skip("no localedef here to make a locale with decimal commas")
    made = subprocess.run([maker, "-i", "de_DE", "-f", "UTF-8", folder / "de_DE.UTF-8"], capture_output=True)
    if made.returncode:
        pytest.skip(f"localedef cannot make a German locale: {made.stderr!r}")
    return {"LOCPATH": str(folder), "LC_ALL": "de_DE.UTF-8"}


def said(cloud):
    """Lines of commands that tell about a cloud, for a program and for a reader."""
    return [("info", cloud, "--json"), ("info", cloud)]


def has_points_in_its_numbers(done):
    """Whether that is so of what a process with these commands has said."""
    assert done.returncode == 0 and done.stderr == ""
    record, end = json.JSONDecoder().raw_decode(done.stdout)
    assert record["extent"]["lowest"] == CLOUD.min(axis=0).tolist()
    table = done.stdout[end:]
    assert "\x1b" not in table and f"{CLOUD[:, 0].min():.4g}"[:5] in table


def test_row_71_numbers_have_a_point_on_a_poor_terminal(cloud):
    has_points_in_its_numbers(commanded(SEVERAL, said(cloud), LC_ALL="C", TERM="dumb"))


def test_row_71_numbers_have_a_point_where_others_write_commas(cloud, saved, tmp_path, german):
    """A program that has taken over the locale of its user, and what it writes."""

    def lines(folder):
        out = tmp_path / folder
        out.mkdir()
        deformed = [("deform", saved, cloud, "-o", out / f"a.{suffix}") for suffix in ("xyz", "csv")]
        return [*deformed, ("export", saved, "--to", "obj,vtp", "-o", out)]

    has_points_in_its_numbers(commanded(WITH_COMMAS + SEVERAL, [*said(cloud), *lines("commas")], **german))
    for words in lines("points"):
        assert main(list(map(str, words))) == 0
    for name in ("a.xyz", "a.csv", "surface.obj", "surface.vtp"):
        assert (tmp_path / "commas" / name).read_bytes() == (tmp_path / "points" / name).read_bytes()


def test_row_72_the_number_of_threads_does_not_matter(tmp_path, monkeypatch):
    """More points than one thread is given here: a hundred and sixtieth of the real number."""
    monkeypatch.setattr(threads, "WORTH", 100)
    points = lumpy(400)
    np.save(tmp_path / "cloud.npy", points)
    done = python("-c", FIT, tmp_path / "cloud.npy", tmp_path / "8.npy", OMP_NUM_THREADS="8", OPENBLAS_NUM_THREADS="8")
    assert done.returncode == 0, done.stderr
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    alone = qf.fit(points, box=(2, 2, 2)).model.mesh(resolution=8).vertices
    np.testing.assert_allclose(np.load(tmp_path / "8.npy"), alone, rtol=0, atol=1e-7 * Frame.of(alone).scale)


def test_rows_32_and_73_a_large_cloud_in_one_gib():
    """`make large` takes ten million points."""
    done = python(Path(__file__).with_name("little_room.py"), 60_000)
    assert done.returncode == 0, done.stdout + done.stderr


def test_row_76_two_runs_write_the_same_bytes(cloud, tmp_path):
    """A fresh process, and this one with another hash seed; all files of a fit."""
    fit = ["fit", str(cloud), "--box", "2,2,2", "-o"]
    done = quadriform(*fit, tmp_path / "fresh", PYTHONHASHSEED="1")
    assert done.returncode == 0, done.stderr
    assert all(line.startswith("warning: ") for line in done.stderr.splitlines())
    assert main([*fit, str(tmp_path / "here")]) == 0
    found = contents(tmp_path / "fresh")
    assert sorted(found) == ["model.json", "report.html", "surface.ply"]
    assert found == contents(tmp_path / "here")


def test_fits_in_processes_and_threads_at_once():
    """Row 77: workers, spawned, forked, and as threads, of a Python without assert: the bytes of fits made here."""
    program = Path(__file__).with_name("at_once.py")
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "MPLBACKEND")}
    done = subprocess.run(
        [sys.executable, "-O", program, "2"], capture_output=True, encoding="utf-8", env=environment, check=True
    )
    *ways, pictures, first = done.stdout.splitlines()
    assert [line.split()[:2] for line in ways] == [[way, "True"] for way in ("spawn", "fork", "threads")]
    assert pictures == "matplotlib False"
    assert first == runpy.run_path(str(program))["fitted"](1).tobytes().hex()
