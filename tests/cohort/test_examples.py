"""The examples for batch systems do what they say."""

import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from cohort_made import listed

from quadriform.cli.main import main
from quadriform.cohort import executors
from quadriform.cohort.layout import read_layout

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture
def recorded(tmp_path):
    """A folder with a command of our name that prints its words, in place of the installed one."""
    command = tmp_path / "bin" / "quadriform"
    command.parent.mkdir()
    command.write_text("#!/bin/sh\nprintf '%s\\n' \"$@\"\n", encoding="utf-8")
    command.chmod(0o755)
    return command.parent


def test_an_array_job_processes_a_cohort_in_parts(tmp_path, recorded, monkeypatch):
    """The first task with its words taken to this process, the last one as it is."""
    installed = Path(sys.executable).parent
    if shutil.which("bash") is None or not (installed / "quadriform").exists():
        pytest.skip("bash or the installed command is not there")
    monkeypatch.setattr(executors, "processes", lambda count: executors.from_executor(ThreadPoolExecutor(1), count))
    cohort = listed(tmp_path, 3, frames=1)
    rows = cohort.read_text(encoding="utf-8").splitlines()
    tiny = [rows[0] + ",box,robust,strength", *(row + ',"2,2,2",no,1e-4' for row in rows[1:])]
    cohort.write_text("\n".join(tiny) + "\n", encoding="utf-8")
    for task, commands in ((1, recorded), (2, installed)):
        array = {
            "SLURM_ARRAY_TASK_ID": str(task),
            "SLURM_ARRAY_TASK_COUNT": "2",
            "SLURM_CPUS_PER_TASK": "1",
            "PATH": f"{commands}{os.pathsep}{os.environ['PATH']}",
        }
        command = ["bash", EXAMPLES / "slurm_array.sh", cohort, tmp_path / "out"]
        done = subprocess.run(command, env=os.environ | array, capture_output=True, encoding="utf-8")
        assert done.returncode == 0, done.stderr
        if commands == recorded:
            assert main(done.stdout.splitlines()) == 0
        assert (tmp_path / "out" / "cohort.html").exists() == (task == 2)
    assert read_layout(tmp_path / "out").blocks == 2
    assert len(list((tmp_path / "out" / "subjects").glob("*/model.json"))) == 3


def test_the_examples_use_existing_options():
    from typer.main import get_command

    from quadriform.cli.main import app

    known = {name for option in get_command(app).commands["cohort"].params for name in option.opts}
    for example in (EXAMPLES / "Snakefile", EXAMPLES / "slurm_array.sh"):
        lines = "\n".join(line for line in example.read_text(encoding="utf-8").splitlines() if not line.startswith("#"))
        used = set(re.findall(r"(?<=\s)--?[a-z][a-z-]*", lines.partition("quadriform cohort")[2]))
        assert {"--shard", "--resume"} <= used <= known | {"-eq"}
