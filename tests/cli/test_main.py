"""Exit codes, one line on stderr, and a start without heavy libraries; some of it in real processes."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from quadriform import __version__, errors
from quadriform.cli import main as entry
from quadriform.cli.options import subcommand
from quadriform.cli.screen import progress_bar

QUADRIFORM = [sys.executable, "-m", "quadriform.cli.main"]
HEAVY = {"numpy", "scipy", "nibabel", "skimage", "trimesh", "matplotlib"}


def process(*words, **options):
    return subprocess.run(
        [*QUADRIFORM, *map(str, words)], capture_output=True, encoding="utf-8", check=False, **options
    )


def test_an_option_without_help_is_refused_by_name():
    def described(*, output: Path, unheard_of: int = 1) -> None:
        """A subcommand.

        Args:
            output: A file.
        """

    with pytest.raises(TypeError, match="unheard_of: an option without help"):
        subcommand(described)


def test_every_subcommand_has_help():
    for words in ([], ["--help"], *([name, "--help"] for name in ("fit", "segment", "deform", "export", "info"))):
        result = CliRunner().invoke(entry.app, words)
        assert "Usage" in result.output


def test_each_option_has_the_help_of_its_docstring():
    """Arguments and options of groups too; sections that are no Args are panels, and none is left in the text."""
    commands = typer.main.get_command(entry.app).commands
    for command in commands.values():
        assert all(each.help for each in command.params), command.name
        assert not re.search(r"^(Args|Images|Method.*):$", command.help, re.MULTILINE)
    fit = {each.name: each for each in commands["fit"].params}
    assert fit["matching"].help == "data-to-model or model-to-data."
    assert (fit["matching"].rich_help_panel, fit["border"].rich_help_panel) == ("Method paper", "Images")
    assert (fit["robust"].secondary_opts, fit["strict"].secondary_opts) == (["--no-robust"], [])
    assert commands["cohort"].params[0].param_type_name == "argument"


def test_help_and_version_start_without_heavy_libraries():
    code = (
        "import sys; from quadriform.cli.main import main\n"
        "codes = [main(['--help']), main(['fit', '--help']), main(['--version']), main([])]\n"
        f"print(codes, sorted({HEAVY} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, encoding="utf-8", check=True)
    assert done.stdout.splitlines()[-1] == "[0, 0, 0, 0] []"
    assert f"quadriform {__version__}" in done.stdout


@pytest.mark.parametrize("words", [("fly",), ("fit", "--what"), ("info",), ("export", "a.json"), ("info", "a", "b")])
def test_usage_errors(terminal, words):
    result = terminal(*words)
    assert result.code == 2
    assert result.out == ""
    assert len(result.err.splitlines()) == 1
    assert "--help" in result.err


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (errors.OptionError, 2),
        (errors.FitError, 3),
        (errors.InputError, 4),
        (errors.PointsError, 4),
        (errors.MaskError, 4),
        (errors.AffineError, 4),
        (errors.DegenerateError, 4),
        (errors.FileFormatError, 4),
        (errors.OutputError, 5),
        (errors.FileLimitError, 6),
        (MemoryError, 6),
        (KeyboardInterrupt, 130),
    ],
)
def test_each_error_has_its_exit_code_and_one_line(terminal, monkeypatch, error, code):
    def fail(*_args, **_options):
        raise error("two\nlines")

    monkeypatch.setattr("quadriform.files.sha256_of", fail)
    Path("a.xyz").write_text("1 2 3\n")
    result = terminal("info", "a.xyz")
    assert result.code == code
    assert result.out == ""
    assert len(result.err.splitlines()) == 1


def test_an_unforeseen_error_leaves_a_report(terminal, monkeypatch, tmp_path):
    def fail(*_args, **_options):
        raise KeyError("a bug")

    monkeypatch.setattr("quadriform.files.sha256_of", fail)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    Path("a.xyz").write_text("1 2 3\n")
    result = terminal("info", "a.xyz")
    assert result.code == 70
    assert "Traceback" not in result.err
    (report,) = tmp_path.glob("quadriform-report-*.txt")
    assert str(report) in result.err
    assert "KeyError: 'a bug'" in report.read_text(encoding="utf-8")


def test_a_real_process_ends_with_one_line_and_the_code(tmp_path):
    """One that succeeds is row 76 of the reliability page."""
    (tmp_path / "nan.xyz").write_text("1 2 nan\n")
    done = process("fit", "nan.xyz", "-o", "out", cwd=tmp_path)
    assert (done.returncode, done.stdout, len(done.stderr.splitlines())) == (4, "", 1)
    assert "Traceback" not in done.stderr
    assert [p.name for p in tmp_path.iterdir()] == ["nan.xyz"]


def test_a_file_in_the_place_of_a_folder_is_refused_in_one_line(terminal, tmp_path, cloud):
    result = terminal("fit", "cloud.xyz", "-o", "cloud.xyz/out")
    assert (result.code, result.out, len(result.err.splitlines())) == (5, "", 1)
    assert [p.name for p in tmp_path.iterdir()] == ["cloud.xyz"]


def test_a_reader_that_goes_away_is_no_error(cloud):
    read, write = os.pipe()
    os.close(read)
    try:
        done = subprocess.run([*QUADRIFORM, "info", str(cloud)], stdout=write, stderr=subprocess.PIPE, check=False)
    finally:
        os.close(write)
    assert done.returncode == 0
    assert done.stderr == b""


def test_a_terminal_that_cannot_show_a_name(tmp_path, cloud):
    cloud.rename(tmp_path / "größe.xyz")
    done = process("info", "größe.xyz", cwd=tmp_path, env=os.environ | {"PYTHONIOENCODING": "ascii"})
    assert done.returncode == 0
    assert done.stderr == ""


def test_no_color_is_respected():
    """Codes 30 to 37 and 90 to 97 set a colour; others, such as 1 for bold, do not."""
    colour = re.compile(r"\x1b\[(\d+;)*[39][0-7]m")
    coloured = os.environ | {"FORCE_COLOR": "1"}
    assert colour.search(process("info", "--help", env=coloured).stdout)
    assert not colour.search(process("info", "--help", env=coloured | {"NO_COLOR": "1"}).stdout)


def test_progress_is_not_shown_without_a_terminal(capsys):
    with progress_bar("work") as show:
        show(1, 2)
    assert capsys.readouterr() == ("", "")


def test_progress_on_a_terminal(monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    monkeypatch.setattr("quadriform.cli.screen.QUIET_SECONDS", -1.0)
    monkeypatch.setenv("FORCE_COLOR", "1")
    with progress_bar("work [bold]") as show:
        show(1, 2)
    shown = capsys.readouterr()
    assert shown.out == ""
    assert "work [bold]" in shown.err
    assert "1/2" in shown.err
