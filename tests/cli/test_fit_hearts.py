"""`quadriform fit --heart` and `--perfusion`: volumes of ventricles that the image cuts, and refusals."""

import json
import re
from pathlib import Path

import nibabel
import numpy as np
import pytest

from quadriform.files import read_model
from quadriform.imaging.reading import read_volume
from quadriform.imaging.ventricle import FACE

pytestmark = pytest.mark.usefixtures("blank_figures")
ENDO, EPI = np.array([20.0, 18.0, 34.0]), np.array([28.0, 26.0, 42.0])
SPACING = np.array([2.5, 2.5, 4.0])
TOP = 14.0
"""The outer face of the last slice, over the centres of both ellipsoids at z = 0."""
CUT = ("--heart", "endo=label:1")
BOTH = (*CUT, "--heart", "epi=label:1+2")
FEW = ("--box", "3,3,3")
"""Ellipsoids need no more control points."""
BRIEF = (*FEW, "--method", "paper", "--iterations", "1")
"""Where it does not matter how well they are met."""


def below(semi_axes, height):
    """Volume in ml of an ellipsoid below z = height, by integration of the areas of its sections."""
    a, b, c = semi_axes
    return np.pi * a * b * (height - height**3 / (3 * c**2) + 2 * c / 3) / 1000


def grid(top, spacing=SPACING):
    """Centres of voxels (i, j, k, 3) about both ellipsoids, and their affine in RAS, whose z is that of LPS."""
    low = np.array([-32.0, -32.0, top - spacing[2] * np.ceil((top + 46) / spacing[2])]) + spacing / 2
    counts = np.rint([64 / spacing[0], 64 / spacing[1], (top - low[2]) / spacing[2] + 0.5]).astype(int)
    affine = np.diag([*spacing, 1.0])
    affine[:3, 3] = low
    return low + np.moveaxis(np.indices(counts), 0, -1) * spacing, affine


def inside(at, semi_axes):
    return ((at / semi_axes) ** 2).sum(axis=-1) < 1


@pytest.fixture
def image(tmp_path):
    """Write a NIfTI image, and return its name."""

    def write(name, values, affine):
        made = nibabel.Nifti1Image(values, affine)
        made.header.set_xyzt_units("mm")
        nibabel.save(made, tmp_path / name)
        return name

    return write


@pytest.fixture
def hearts(image):
    """A label image of a cavity 1 in a wall 2 that is cut at the height `top`; `axes` of the world are x, y, z."""

    def write(name="heart.nii", top=TOP, axes=(0, 1, 2), endo=ENDO):
        at, affine = grid(top)
        values = np.where(inside(at, endo), 1, np.where(inside(at, EPI), 2, 0))
        return image(name, values.astype(np.uint8), affine[[*axes, 3]])

    return write


def record_of(result):
    assert result.code == 0, result.err
    return json.loads(result.out)


def test_the_cavity_counts_below_the_face_where_the_image_cuts_it(terminal, hearts, tmp_path):
    record = record_of(terminal("fit", hearts(), *CUT, *FEW, "-o", "out", "--json"))
    assert record["volume_ml"] == pytest.approx(below(ENDO, TOP), rel=0.02)
    counted = (read_volume(tmp_path / "heart.nii").values == 1).sum() * SPACING.prod() / 1000
    assert record["volume_ml"] == pytest.approx(counted, rel=0.02)
    assert record["closed_volume_ml"] > 1.05 * record["volume_ml"] and "wall_volume_ml" not in record
    assert record["base"]["direction"] == [0, 0, 1] and record["base"]["point"][2] == pytest.approx(TOP)
    assert record["status"] == "ok" and "cuts the object at last k" in record["notes"][0]
    model = read_model("out/model.json")
    assert model.landmarks.base.point[2] == pytest.approx(TOP)
    assert f"below {FACE}" in (tmp_path / "out/report.html").read_text()


def test_later_commands_count_below_the_base_that_the_model_was_stored_with(terminal, hearts, tmp_path):
    """Whatever is made of the model: the volume is that of the fit, and says below what."""
    record = record_of(terminal("fit", hearts(), *BOTH, *BRIEF, "-o", "out", "--space", "RAS", "--json"))
    measured = record_of(terminal("measure", "out/model.json", "--json"))["measures"]
    found = {row["quantity"]: row for row in measured}
    assert found["end-diastolic volume"]["value"] == pytest.approx(record["volume_ml"], rel=1e-9)
    assert found["end-diastolic volume, closed"]["value"] == pytest.approx(record["closed_volume_ml"], rel=1e-9)
    assert f"below {FACE}" in found["end-diastolic volume"]["how"]
    assert found["myocardial mass"]["value"] == pytest.approx(1.05 * record["wall_volume_ml"], rel=1e-9)
    assert terminal("report", "out/model.json", "-o", "page.html").code == 0
    volume = f"{record['volume_ml']:.4g} ml"
    for page in ("page.html", "out/report.html"):
        assert volume in (tmp_path / page).read_text() and '"planes":null' not in (tmp_path / page).read_text()
    compared = record_of(terminal("compare", "out/model.json", "out/model.json", "--surface", "endo", "--json"))
    assert compared["volume_below_base_a"] == pytest.approx(1000 * record["volume_ml"], rel=1e-9)
    assert FACE in terminal("info", "out/model.json").out.replace("\n", " ")


def test_the_example_of_the_page_finds_the_ejection_fraction_of_two_phases(terminal, hearts):
    """The phases have different last slices; their volumes are known in closed form."""
    systole, top = 0.8 * ENDO, TOP - SPACING[2]
    hearts("ED.nii.gz")
    hearts("ES.nii.gz", top, endo=systole)
    page = (Path(__file__).resolve().parents[2] / "docs" / "command_line.md").read_text(encoding="utf-8")
    fit, measure = re.search(
        r"### The ejection fraction .*?```\nquadriform (.*?)\nquadriform (.*?)\n```", page, re.DOTALL
    ).groups()
    assert terminal(*fit.split()).code == 0
    found = {row["quantity"]: row for row in record_of(terminal(*measure.split(), "--json"))["measures"]}
    exact = 100 * (1 - below(systole, top) / below(ENDO, TOP))
    assert found["ejection fraction"]["value"] == pytest.approx(exact, abs=1.5)


def test_a_base_that_is_given_later_replaces_the_stored_one(terminal, hearts):
    record_of(terminal("fit", hearts(), *CUT, *FEW, "-o", "out", "--json"))
    found = record_of(terminal("measure", "out/model.json", "--base", "0,0,6,0,0,1", "--json"))["measures"][0]
    assert found["value"] == pytest.approx(below(ENDO, 6.0), rel=0.02) and "below a fixed plane" in found["how"]


def test_the_wall_counts_below_the_same_face_and_the_frame_does_not_matter(terminal, hearts):
    name = hearts(axes=(2, 0, 1))
    record = record_of(terminal("fit", name, *BOTH, *FEW, "-o", "out", "--space", "RAS", "--json"))
    assert record["volume_ml"] == pytest.approx(below(ENDO, TOP), rel=0.02)
    wall = below(EPI, TOP) - below(ENDO, TOP)
    assert record["wall_volume_ml"] == pytest.approx(wall, rel=0.03)
    assert record["base"]["point"][0] == pytest.approx(TOP) and record["base"]["direction"] == [1, 0, 0]
    shown = terminal("fit", name, *BOTH, *BRIEF, "-o", "shown").out
    for row in ("cavity volume below the base", "cavity volume, closed surface", "wall volume below the base"):
        assert row in shown
    assert f"-{TOP:g}," in shown and "/-1,0,0" in shown  # in LPS, the frame of images


@pytest.mark.parametrize("words", [(*CUT, *FEW), (*BOTH, "--box", "4,4,4")], ids=["cavity", "wall"])
def test_volumes_are_those_within_the_image_where_it_cuts_the_apex_too(terminal, hearts, tmp_path, words):
    name = hearts()
    affine = nibabel.load(name).affine
    first = round((-18 - affine[2, 3]) / SPACING[2])
    width, depth, height = nibabel.load(name).shape
    region = f"0:{width},0:{depth},{first}:{height}"
    record = record_of(terminal("fit", name, *words, "--region", region, "-o", "out", "--json"))
    low = affine[2, 3] + (first - 0.5) * SPACING[2]
    assert record["volume_ml"] == pytest.approx(below(ENDO, TOP) - below(ENDO, low), rel=0.03)
    if "wall_volume_ml" in record:
        wall = [below(EPI, z) - below(ENDO, z) for z in (TOP, low)]
        assert record["wall_volume_ml"] == pytest.approx(wall[0] - wall[1], rel=0.1)


def test_a_given_base_bounds_the_volume_itself(terminal, hearts):
    record = record_of(terminal("fit", hearts(), *CUT, *FEW, "--base", "0,0,6/0,0,2", "-o", "out", "--json"))
    assert record["base"] == {"point": [0, 0, 6], "direction": [0, 0, 1]}
    assert record["volume_ml"] == pytest.approx(below(ENDO, 6.0), rel=0.02)


def test_a_cavity_that_ends_inside_the_image_is_closed(terminal, hearts):
    shown = terminal("fit", hearts(top=50.0), *CUT, *BRIEF, "-o", "a")
    assert "cavity volume " in shown.out and "below the base" not in shown.out and "closed" not in shown.out
    record = record_of(terminal("fit", "heart.nii", *CUT, *FEW, "-o", "b", "--json"))
    assert record["base"] is None and record["volume_ml"] == record["closed_volume_ml"]
    assert record["volume_ml"] == pytest.approx(4e-3 / 3 * np.pi * ENDO.prod(), rel=0.02)


def test_several_images_give_a_model_each(terminal, hearts, cloud, tmp_path):
    diastole, systole = hearts("ED.nii"), hearts("ES.nii", top=6.0)
    shown = terminal("fit", diastole, systole, cloud, *CUT, *BRIEF, "-o", "out")
    assert shown.code == 2 and "goes with images" in shown.err  # the points beside the images
    assert "cavity" in shown.out and shown.out.count(" ml") == 2
    assert {path.parent.name for path in tmp_path.glob("out/*/model.json")} == {"ED", "ES"}
    records = record_of(terminal("fit", diastole, systole, *CUT, *FEW, "-o", "again", "--json"))
    assert [each["volume_ml"] for each in records] == pytest.approx([below(ENDO, TOP), below(ENDO, 6.0)], rel=0.02)


def test_the_method_of_the_paper_has_no_base_but_its_volume_has(terminal, hearts):
    record = record_of(terminal("fit", hearts(), *CUT, *BRIEF, "-o", "out", "--json"))
    assert record["base"]["direction"] == [0, 0, 1]


def test_a_perfusion_image_gives_both_walls_below_its_opening(terminal, image):
    at, affine = grid(46.0, np.array([2.5, 2.5, 2.5]))
    wall = inside(at, EPI) & ~inside(at, ENDO) & (at[..., 2] < TOP)
    record = record_of(
        terminal("fit", image("spect.nii", 100.0 * wall, affine), "--perfusion", *FEW, "-o", "a", "--json")
    )
    height = record["base"]["point"][2]
    assert TOP - 8 < height < TOP and record["base"]["direction"][2] > 0.999
    assert record["volume_ml"] == pytest.approx(below(ENDO, height), rel=0.05)
    assert record["wall_volume_ml"] == pytest.approx(below(EPI, height) - below(ENDO, height), rel=0.05)


def test_other_fits_have_no_volume_of_a_heart(terminal, hearts):
    record = record_of(terminal("fit", hearts(), "--label", "1", *BRIEF, "-o", "out", "--json"))
    assert "volume_ml" not in record and "base" not in record


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((*CUT, "--surface", "endo=label:1"), "--heart and --surface exclude"),
        ((*CUT, "--perfusion"), "--heart and --perfusion exclude"),
        ((*CUT, "--label", "1"), "--heart and --label exclude"),
        ((*CUT, "--threshold", "otsu"), "--heart and --threshold exclude"),
        ((*CUT, "--fill-holes"), "--heart and --fill-holes exclude"),
        ((*CUT, "--columns", "x,y,z"), "--heart and --columns exclude"),
        (("--perfusion", "--label", "1"), "--perfusion and --label exclude"),
        (("--perfusion", "--surface", "a=b"), "--perfusion and --surface exclude"),
        (("--heart", "epi=label:1+2"), "epi without endo"),
        ((*CUT, *CUT), "each once"),
        ((*CUT, "--heart", "rv=label:3"), "expected endo=... and, for the wall, epi=..."),
        ((*CUT, "--heart", "epi=label:1"), "all labels of epi (1) are labels of endo"),
        (("--heart", "endo=1"), "name=label:1"),
        (("--heart", "endo=preset:magic"), "'acdc'"),
    ],
)
def test_wrong_options_are_refused_in_one_line(terminal, hearts, tmp_path, words, message):
    result = terminal("fit", hearts(), *words, "-o", "out")
    assert result.code == 2 and message in result.err
    assert len(result.err.splitlines()) == 1 and not (tmp_path / "out").exists()


def test_wrong_inputs_are_refused_in_one_line(terminal, hearts, cloud):
    for words, code, message in [
        ((cloud, *CUT), 2, "--heart goes with images, found the file of points"),
        ((cloud, "--perfusion"), 2, "--perfusion goes with images"),
        (CUT, 2, "at least one INPUT image"),
        ((hearts(), "--heart", "endo=label:7"), 4, "no voxel has the label 7"),
        (("heart.nii", "--heart", "endo=label:2", "--heart", "epi=label:1+2"), 4, "are the labels swapped?"),
        (("heart.nii", "--heart", "endo=label:blood"), 2, "blood"),
        (("heart.nii", "--heart", "endo=preset:acdc"), 4, "does not follow the preset 'acdc'"),
        (("heart.nii", *CUT, "--base", "0,0,-90/0,0,1"), 2, "try the reverse"),
        (("heart.nii", *CUT, "--base", "0,0,-10/0,0,1"), 2, "the plane goes through the middle of the data"),
        (("heart.nii", "--heart", "endo=label:1+2", "--heart", "epi=label:3"), 4, "no voxel has the label 3"),
        (("heart.nii", "--surface", "endo=label:1", "--surface", "epi=label:1"), 4, "no wall between them"),
        (("heart.nii", *CUT, "--base", cloud), 2, "expected a plane x,y,z/nx,ny,nz, found a file"),
        (("missing.nii", *CUT), 4, "missing.nii"),
    ]:
        result = terminal("fit", *words, "-o", "out")
        assert (result.code, len(result.err.splitlines())) == (code, 1), result.err
        assert message in result.err
