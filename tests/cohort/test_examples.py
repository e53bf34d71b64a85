"""The examples for batch systems do what they say."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from cohort_made import listed

from quadriform.cohort.layout import read_layout

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.mark.slow
def test_an_array_job_processes_a_cohort_in_parts(tmp_path):
    if shutil.which("bash") is None or not (Path(sys.executable).parent / "quadriform").exists():
        pytest.skip("bash or the installed command is not there")
    cohort = listed(tmp_path, 3, frames=1)
    rows = cohort.read_text(encoding="utf-8").splitlines()
    tiny = [rows[0] + ",box,robust,strength", *(row + ',"2,2,2",no,1e-4' for row in rows[1:])]
    cohort.write_text("\n".join(tiny) + "\n", encoding="utf-8")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for task in (1, 2):
        array = {
            "SLURM_ARRAY_TASK_ID": str(task),
            "SLURM_ARRAY_TASK_COUNT": "2",
            "SLURM_CPUS_PER_TASK": "1",
            "PATH": path,
        }
        command = ["bash", EXAMPLES / "slurm_array.sh", cohort, tmp_path / "out"]
        done = subprocess.run(command, env=os.environ | array | {"PATH": path}, capture_output=True, encoding="utf-8")
        assert done.returncode == 0, done.stderr
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
