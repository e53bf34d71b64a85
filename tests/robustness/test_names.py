"""Names that would be one after they are written down, as text, as a file name or in UTF-8, are refused."""

from pathlib import Path

import numpy as np
import pytest
from shapes_made import lumpy, made

import quadriform as qf
from quadriform.cli.main import main
from quadriform.cli.options import check_file_names
from quadriform.errors import OptionError
from quadriform.points import by_name

CLOUD = lumpy(60)
ALIKE = [{1: CLOUD, "1": CLOUD / 2}, {True: CLOUD, "True": CLOUD / 2}, {None: CLOUD, "None": CLOUD / 2}]


@pytest.mark.parametrize("clouds", ALIKE, ids=lambda clouds: repr(next(iter(clouds))))
@pytest.mark.parametrize(
    "call",
    [
        qf.fit,
        lambda clouds: qf.refine(dict.fromkeys(clouds, made()), clouds),
        lambda clouds: qf.track([clouds, clouds]),
        lambda clouds: qf.fit({"1": CLOUD}, weights=clouds),
    ],
    ids=["fit", "refine", "track", "weights"],
)
def test_names_that_are_written_alike_are_refused(call, clouds):
    with pytest.raises(OptionError, match="two names are both written"):
        call(clouds)


def test_a_number_as_a_name_goes_with_the_same_number():
    plain = qf.fit({"1": CLOUD}, weights={"1": np.ones(60)}, box=(2, 2, 2))
    found = qf.fit({1: CLOUD}, weights={1: np.ones(60)}, box=(2, 2, 2))
    assert list(found.model.surfaces) == ["1"]
    np.testing.assert_array_equal(found.model.box.control_points, plain.model.box.control_points)


def test_half_of_a_surrogate_pair_is_no_name():
    with pytest.raises(OptionError, match="surrogate pair"):
        by_name({"\ud800": CLOUD}, "points")


@pytest.mark.parametrize("pair", [("a", "a"), ("Endo", "endo"), ("stra\u00dfe", "STRASSE"), ("\u00e9", "e\u0301")])
def test_files_that_some_file_systems_take_for_one(pair):
    with pytest.raises(OptionError, match="two surfaces would both write to"):
        check_file_names([Path("out") / name for name in pair], "two surfaces")


def test_the_terminal_refuses_them_before_the_work(tmp_path, capsys):
    for name in ("a", "A"):
        np.savetxt(tmp_path / f"{name}.xyz", CLOUD)
    files = [str(tmp_path / "a.xyz"), str(tmp_path / "A.xyz")]
    assert main(["fit", *files, "-o", str(tmp_path / "out")]) == 2
    assert (
        main(["fit", "--surface", f"endo={files[0]}", "--surface", f"Endo={files[1]}", "-o", str(tmp_path / "out")])
        == 2
    )
    assert capsys.readouterr().err.count("differ in case only") == 2
    assert not (tmp_path / "out").exists()
