"""The list of subjects: what is refused, all of it at once, and what a row means."""

import pytest

from quadriform.cohort.manifest import option, read_manifest
from quadriform.errors import FileFormatError, InputError, OptionError
from quadriform.imaging.object_choice import Labels
from quadriform.imaging.ventricle_files import LabelledHeart


@pytest.fixture
def write(tmp_path):
    def of_text(text):
        path = tmp_path / "list.csv"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return path

    return of_text


def test_a_row_defines_a_subject(write):
    text = "\ufeffid,surface,input,box,strength,shift_slices\r\n"
    text += "a-1,endo=label:1;epi=label:1+2,a.nii.gz,,1e-6,yes\r\n\r\nb.2,, one.ply; two.ply ,5,,\r\n"
    listed = read_manifest(write(text.replace(",5,,", ',"5,5,5",,')), {})
    first, second = listed.rows()
    assert (first.number, first.id, first.input) == (0, "a-1", ("a.nii.gz",))
    assert first.surfaces == (("endo", "label:1"), ("epi", "label:1+2"))
    assert dict(first.options) == {"strength": 1e-6, "shift_slices": True}
    assert (second.id, second.input, second.surfaces) == ("b.2", ("one.ply", "two.ply"), ())
    assert listed.subjects == 2 and listed.box == (5, 5, 5)


def test_options_of_the_whole_cohort_give_way_to_those_of_a_row(write):
    listed = read_manifest(write("id,input,strategy\na,a.ply,previous\nb,b.ply,\n"), {"strategy": "cycle"})
    assert [dict(row.options)["strategy"] for row in listed.rows()] == ["previous", "cycle"]


def test_ventricles_are_those_of_the_row_or_of_the_whole_cohort(write):
    path = write("id,input,heart\na,a.nii,endo=label:3;epi=label:2+3\nb,b.nii,\n")
    hearts = [row.reading["heart"] for row in read_manifest(path, {"heart": option("heart", "endo=label:1")}).rows()]
    assert hearts == [LabelledHeart(Labels((3,)), Labels((2, 3))), LabelledHeart(Labels((1,)))]


@pytest.mark.parametrize(("column", "cell"), [("surface", "endo=label:1"), ("columns", '"x,y,z"')])
def test_a_ventricle_goes_with_no_other_choice_of_points(write, column, cell):
    path = write(f"id,input,{column}\na,a.nii,{cell}\n")
    with pytest.raises(InputError, match=f"line 2: heart and {column} exclude each other"):
        read_manifest(path, {"heart": option("heart", "endo=label:1")})


def test_every_faulty_row_is_named_by_its_line_and_none_by_its_id(write):
    rows = [
        "good,a.ply,,",
        "bad id,a.ply,,",
        "GOOD,a.ply,,",
        "c,,,",
        "d,a.ply,endo=b.ply,",
        "e,,endo=label:1,",
        "f,a.nii,endo,",
        "g,a.nii,endo=label:-1,",
        "h,a.nii,endo=label:1;endo=label:2,",
        "i,a.ply,,weekly",
        "j,a.ply",
        "k,,endo=b.ply;epi=label:2,",
        "../l,a.ply,,",
    ]
    with pytest.raises(InputError, match="12 faulty rows, nothing was fitted") as refused:
        read_manifest(write("id,input,surface,strategy\n" + "\n".join(rows)), {})
    text = str(refused.value)
    assert [f"line {line}:" in text for line in range(2, 15)] == [False] + 12 * [True]
    assert "the same as in line 2" in text and "bad id" not in text and "GOOD" not in text


@pytest.mark.parametrize(
    "text",
    [
        "id;input\na;b\n",
        "name,input\na,b\n",
        "id,input,inptu\na,b,c\n",
        "id,input,input\na,b,c\n",
        "id,input\n",
        b"id,input\na,\xff\n",
        'id,input\na,"b\n',
    ],
)
def test_what_is_no_such_table_is_refused(write, text):
    with pytest.raises(FileFormatError, match=r"list\.csv"):
        read_manifest(write(text), {})


def test_one_box_for_all(write):
    path = write('id,input,box\na,a.ply,"5,5,5"\nb,b.ply,"4,5,5"\n')
    with pytest.raises(InputError, match=r"line 3: box \(4, 5, 5\)"):
        read_manifest(path, {})


@pytest.mark.parametrize(
    "word",
    [
        "box=5,5",
        "box=auto",
        "box=1,5,5",
        "strength=-1",
        "robust=maybe",
        "period=0",
        "iterations=0",
        "strategy=alone",
        "knid=x",
        "heart=epi=label:1",
        "heart=endo=label:x1;endo=label:2",
    ],
)
def test_invalid_values_of_options_are_refused(word):
    with pytest.raises(OptionError, match=word.split("=")[0]):
        option(*word.split("=", 1))


@pytest.mark.parametrize(("word", "value"), [("period=none", None), ("period=0.8", 0.8), ("robust=no", False)])
def test_words_of_options(word, value):
    assert option(*word.split("=")) == value
