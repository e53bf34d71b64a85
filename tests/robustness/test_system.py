"""Rows 66 to 77 of docs/reliability.md: disks, signals, locales, threads and processes; all of it in real processes."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from shapes_made import lumpy

import quadriform as qf
from quadriform.cli.main import main
from quadriform.files.atomic import write_bytes
from quadriform.points import Frame

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
path.write_bytes(old)
for turn in range(50):
    child = os.fork()
    while not child:
        write_bytes(path, new, True)
        write_bytes(path, old, True)
    time.sleep(instants.uniform(0.001, 0.02))
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
    "import resource, signal, sys\n"
    "sys.dont_write_bytecode = True\n"  # Python would keep byte code cut off at the limit, and fail on it ever after
    "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
    "resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
    "from quadriform.cli.main import main\n"
    "sys.exit(main(sys.argv[1:]))\n"
)
WITH_COMMAS = (
    "import json, locale, sys\n"
    "locale.setlocale(locale.LC_ALL, '')\n"
    "if locale.format_string('%.1f', 1.5) != '1,5': sys.exit('this locale has no commas')\n"
    "from quadriform.cli.main import main\n"
    "sys.exit(max(main(words) for words in json.loads(sys.argv[1])))\n"
)
FIT = (
    "import sys, numpy as np, quadriform as qf\n"
    "fit = qf.fit(np.load(sys.argv[1]), box=(3, 3, 3))\n"
    "np.save(sys.argv[2], fit.model.mesh(resolution=8).vertices)\n"
)


def python(*words, **environment):
    return subprocess.run(
        [sys.executable, *map(str, words)], capture_output=True, encoding="utf-8", env=os.environ | environment
    )


def quadriform(*words, **environment):
    return python("-m", "quadriform.cli.main", *words, **environment)


@pytest.fixture
def cloud(tmp_path):
    np.savetxt(tmp_path / "cloud.xyz", lumpy(300), fmt="%.17g")
    return tmp_path / "cloud.xyz"


@pytest.fixture
def saved(cloud, tmp_path):
    """A model, and what was exported of it before."""
    qf.save(qf.fit(lumpy(300), method="paper", iterations=1).model, tmp_path / "model.json")
    (tmp_path / "surface.ply").write_bytes(b"old")
    return tmp_path / "model.json"


@pytest.mark.slow
def test_row_68_a_file_that_cannot_grow_leaves_the_old_one(saved, tmp_path):
    """As on a full disk: the system refuses the write itself."""
    before = sorted(path.name for path in tmp_path.iterdir())
    done = python("-c", LIMITED, "export", saved, "--to", "ply", "-o", tmp_path, "--force")
    assert done.returncode == 5
    assert len(done.stderr.splitlines()) == 1 and "writing failed, nothing was changed" in done.stderr
    assert (tmp_path / "surface.ply").read_bytes() == b"old"
    assert sorted(path.name for path in tmp_path.iterdir()) == before


@pytest.mark.slow
@pytest.mark.parametrize("limit", [1000, 12_000, 60_000])
def test_row_68_results_that_do_not_fit_on_the_disk_leave_the_old_ones(cloud, tmp_path, limit):
    """The model fits, the surface too, the page does not: all files stay those of the earlier run."""
    words = ("fit", cloud, "-o", tmp_path / "out", "--method", "paper", "--iterations", "1")
    assert main([str(word) for word in words]) == 0
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    np.savetxt(cloud, lumpy(300, seed=5), fmt="%.17g")
    done = python("-c", LIMITED.replace("(1000, 1000)", f"({limit}, {limit})"), *words, "--force")
    assert done.returncode == 5
    assert len(done.stderr.splitlines()) == 1 and "writing failed, nothing was changed" in done.stderr
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before


@pytest.mark.slow
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


@pytest.mark.slow
def test_row_69_whole_fits_that_are_stopped():
    """Three of them, a signal each; fifty by `make kill`."""
    here = Path(__file__)
    paths = os.pathsep.join([str(here.parents[1]), os.environ.get("PYTHONPATH", "")])
    done = python(here.with_name("killed_fits.py"), 3, PYTHONPATH=paths)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == "3 of 3 as promised"


@pytest.mark.slow
def test_row_70_two_writers_of_one_file(tmp_path):
    """Each 200 times; whoever reads meanwhile sees one of the two files, whole."""
    path, seen = tmp_path / "a", set()
    path.write_bytes(OLD)
    children = [
        subprocess.Popen([sys.executable, "-c", WRITER, str(path), "100"], stdout=subprocess.DEVNULL) for _ in "12"
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


def same_numbers(cloud, run, names):
    """What a terminal says of a cloud has points in its numbers."""
    done = run("info", cloud, "--json", **names)
    assert done.returncode == 0 and done.stderr == ""
    assert json.loads(done.stdout)["extent"]["lowest"] == lumpy(300).min(axis=0).tolist()
    table = run("info", cloud, **names)
    assert table.returncode == 0 and "\x1b" not in table.stdout
    assert f"{lumpy(300)[:, 0].min():.4g}"[:5] in table.stdout


@pytest.mark.slow
def test_row_71_numbers_have_a_point_on_a_poor_terminal(cloud):
    same_numbers(cloud, quadriform, {"LC_ALL": "C", "TERM": "dumb"})


@pytest.mark.slow
def test_row_71_numbers_have_a_point_where_others_write_commas(cloud, saved, tmp_path, german):
    """A program that has taken over the locale of its user, and what it writes."""

    def run(*words, **names):
        return commanded([words], **names)

    def commanded(lines, **names):
        return python("-c", WITH_COMMAS, json.dumps([list(map(str, words)) for words in lines]), **names)

    def lines(folder):
        out = tmp_path / folder
        out.mkdir()
        deformed = [("deform", saved, cloud, "-o", out / f"a.{suffix}") for suffix in ("xyz", "csv")]
        return [*deformed, ("export", saved, "--to", "obj,vtp", "-o", out)]

    same_numbers(cloud, run, german)
    done = commanded(lines("commas"), **german)
    assert done.returncode == 0, done.stderr
    for words in lines("points"):
        assert main(list(map(str, words))) == 0
    for name in ("a.xyz", "a.csv", "surface.obj", "surface.vtp"):
        assert (tmp_path / "commas" / name).read_bytes() == (tmp_path / "points" / name).read_bytes()


@pytest.mark.slow
def test_row_72_the_number_of_threads_does_not_matter(tmp_path):
    """More points than one thread is given."""
    np.save(tmp_path / "cloud.npy", lumpy(18_000))
    found = []
    for threads in ("1", "2", "8"):
        out = tmp_path / f"{threads}.npy"
        done = python("-c", FIT, tmp_path / "cloud.npy", out, OMP_NUM_THREADS=threads, OPENBLAS_NUM_THREADS=threads)
        assert done.returncode == 0, done.stderr
        found.append(np.load(out))
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], rtol=0, atol=1e-7 * Frame.of(found[0]).scale)


@pytest.mark.slow
def test_rows_32_and_73_a_large_cloud_in_one_gib():
    """`make large` takes ten million points."""
    done = python(Path(__file__).with_name("little_room.py"), 100_000)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
def test_row_76_two_runs_write_the_same_bytes(cloud, tmp_path):
    """Fresh processes, two hash seeds, all files of a fit."""
    for seed in ("0", "1"):
        done = quadriform("fit", cloud, "-o", tmp_path / seed, "--box", "2,2,2", PYTHONHASHSEED=seed)
        assert done.returncode == 0, done.stderr
    names = sorted(path.name for path in (tmp_path / "0").iterdir())
    assert names == ["model.json", "report.html", "surface.ply"]
    for name in names:
        assert (tmp_path / "0" / name).read_bytes() == (tmp_path / "1" / name).read_bytes(), name


@pytest.mark.slow
@pytest.mark.parametrize(("optimised", "count"), [((), 4), (("-O",), 1)], ids=["77 plain", "77 python -O"])
def test_fits_in_processes_and_threads_at_once(optimised, count):
    """Workers, spawned, forked, and as threads of one process: the bytes of fits one after the other."""
    program = Path(__file__).with_name("at_once.py")
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "MPLBACKEND")}
    done = subprocess.run(
        [sys.executable, *optimised, program, str(count)],
        capture_output=True,
        encoding="utf-8",
        env=environment,
        check=True,
    )
    lines = done.stdout.splitlines()
    assert [line.split()[:2] for line in lines[:3]] == [[way, "True"] for way in ("spawn", "fork", "threads")]
    assert lines[3] == "matplotlib False"
