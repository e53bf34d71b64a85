"""Tables and arrays as other programs write them: the right numbers or one typed error, never anything else.

Warnings of Python count as failures in all tests.
"""

import io
import itertools

import numpy as np
import pytest

from quadriform.errors import QuadriformError
from quadriform.files.points import read_point_set

ROWS = np.array([[1.0, 2.0, 30.0], [-4.5, 5.25, 6.0], [0.125, 7.0, -8.0]])
SEPARATORS = [",", ";", "\t", " ", "  ", ", ", " ; ", "|"]
ENDS = ["\n", "\r\n", "\r"]
HEADS = [
    "",
    "x,y,z",
    "# x y z",
    "//X Y Z",
    "sep=;",
    "3",
    "# points: 3",
    "ID,x,y,z",
    "x,y,z,",
    "version 1",
    "x y z",
    "!",
]
NUMBERS = ["%r", "%+.3e", "%8.3f", '"%r"', "'%r'", "%.3fD+00", "%.3f,", "%g "]
WORDS = [
    *(
        "inf",
        "-Infinity",
        "nan",
        "NA",
        "#N/A",
        "null",
        "1.#INF",
        "1e400",
        "1e999999",
        "-1e31",
        "0x1F",
        "1_000",
        "1,000",
    ),
    *("1'000", "\u0661", "\u00b2", "\u00bd", "1e", "+-1", "1..2", "1D3", "\u22121", "True", "1+2j", "\x1a", "\x85"),
    *("\u2028", "\ufeff", "", "9" * 400, "9" * 5000, "0." + "1" * 5000),
]
PIECES = [
    *(
        b"\n",
        b"   ",
        b"#",
        b"//",
        b"sep=;",
        b"sep=;\n",
        b"3\n",
        b"3",
        b"x,y,z",
        b"x,y,z\n",
        b"\x00",
        b",,,\n,,,",
        b";;\n",
    ),
    *(b"\t\t\n", b"0\n1\n2\n", b'"x\ny",2,3\n', b"a" * 100_000, "x [\u00b5m],y,z\n1,2,3\n".encode("cp1252")),
    *("1,2,3\n".encode(code) for code in ("utf-16", "utf-16-le", "utf-32")),
    "\ud800,y,z\n1,2,3\n".encode("utf-8", "surrogatepass"),
]


def read(tmp_path, content, name="p.csv"):
    """The points, or None where they are refused."""
    (tmp_path / name).write_bytes(content)
    try:
        return read_point_set(tmp_path / name).points
    except QuadriformError as error:
        assert str(error)
        return None


@pytest.mark.parametrize("head", HEADS, ids=repr)
def test_every_variant_gives_the_right_numbers_or_an_error(tmp_path, head):
    right = 0
    for separator, end, number in itertools.product(SEPARATORS, ENDS, NUMBERS):
        rows = [separator.join(number % value for value in row) for row in ROWS.tolist()]
        found = read(tmp_path, end.join([*([head.replace(",", separator)] if head else []), *rows, ""]).encode())
        if found is not None:
            np.testing.assert_allclose(found, ROWS, atol=6e-4)
            right += 1
    assert right >= 18 or head in ("ID,x,y,z", "version 1", "!", "sep=;", "x y z", "x,y,z,", "x,y,z")


@pytest.mark.parametrize("word", WORDS, ids=lambda word: ascii(word[:12]))
def test_a_strange_number_is_read_as_python_reads_it_or_refused(tmp_path, word):
    for separator, row in itertools.product(",; \t", (0, 1)):
        table = [[repr(value) for value in line] for line in ROWS.tolist()]
        table[row][1] = word
        found = read(tmp_path, "\n".join(separator.join(line) for line in table).encode())
        if found is not None:
            wanted = ROWS.copy()
            wanted[row, 1] = float(word)
            np.testing.assert_array_equal(found, wanted)
    for text in (f"{word}\n1 2 3\n4 5 6\n", f"# points: {word}\n1 2 3\n4 5 6\n", f"# x y {word}\n1 2 3\n4 5 6\n"):
        found = read(tmp_path, text.encode())
        assert found is None or np.array_equal(found, [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize("content", PIECES, ids=lambda content: repr(content[:16]))
def test_what_is_no_table_is_refused(tmp_path, content):
    assert read(tmp_path, content) is None


@pytest.mark.parametrize(
    "kind", [f"{order}{kind}" for order in "<>" for kind in ("f2", "f4", "f8", "i2", "i4", "i8", "u2")]
)
@pytest.mark.parametrize("order", "CF")
def test_arrays_of_every_type_and_order(tmp_path, kind, order):
    wanted = np.abs(ROWS).astype(kind)
    stream = io.BytesIO()
    np.save(stream, np.asarray(wanted, order=order))
    np.testing.assert_array_equal(read(tmp_path, stream.getvalue(), "p.npy"), wanted.astype(float))


@pytest.mark.parametrize("kind", ["?", "c16", "S3", "U3", "M8[s]", "m8[s]", "O", "V8", "f8,f8,f8", "i1,O,f8"])
def test_arrays_of_other_types_are_refused(tmp_path, kind):
    stream = io.BytesIO()
    np.save(stream, np.zeros((4, 3) if "," not in kind else 4, dtype=kind), allow_pickle=True)
    assert read(tmp_path, stream.getvalue(), "p.npy") is None
