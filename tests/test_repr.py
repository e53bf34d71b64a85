"""`repr` of every public object: a few lines that a user can read, without the contents of arrays."""

import inspect
import re
from dataclasses import replace

import numpy as np
import pytest
from priors_made import meshes
from shapes_made import lumpy

import quadriform as qf
from quadriform.errors import WarningKind
from quadriform.heart.synthetic import SyntheticVentricle
from quadriform.point_sets import point_set
from quadriform.shapes.wall import wall_mesh

CLOUD = lumpy(100)
GUIDE_POINTS = "Index\tx\ty\tz\tcontour type\tslice\tweight\n" + "".join(
    f"{k}\t{k}\t1\t2\tSAX_LV_ENDOCARDIAL\t1\t1\n" for k in range(9)
)
AT_MOST = 6


@pytest.fixture(scope="module")
def objects():
    """One object of each public class, and of each that a public function returns."""
    far = np.vstack([CLOUD, 5 * CLOUD[:9]])
    fit = qf.fit({"endo": 0.8 * CLOUD, "epi": far}, box=(3, 3, 3))
    times = np.arange(3) / 3
    heart = SyntheticVentricle()
    values = np.zeros((12, 12, 12), dtype=np.int16)
    values[3:9, 3:9, 3:9], values[4:8, 4:8, 4:8] = 2, 1
    volume = qf.Volume(values, np.diag([2.0, 2.0, 2.0, 1.0]))
    prior = qf.learn_prior(meshes(), box=(3, 3, 3))
    track = qf.track([CLOUD, 1.1 * CLOUD, CLOUD], box=(3, 3, 3), times=times)
    return [
        *(fit, fit.model, fit.model.box, fit.model.superquadric(), fit.model.mesh("epi"), fit.model.record),
        *(track, track.moving, qf.fit_superquadric(far), point_set(CLOUD), fit.model.foot_points(CLOUD)),
        *(volume, qf.segment(volume, select=qf.Labels((1,))), qf.points_from_image(volume, select=qf.Labels((1, 2)))),
        *(qf.ventricle_from_labels(volume, cavity=qf.Labels((1,)), wall=qf.Labels((2,))), qf.Labels((1,))),
        *(qf.measure([heart.model(t) for t in times], times=times), wall_mesh(heart.model(0.0))),
        *(prior, prior.report, qf.SliceMove(*np.zeros((3, 3)), np.eye(3), np.ones(6))),
        *(qf.Percentile(0.5, "all"), qf.surface_distances(fit.model.mesh("epi"), fit.model.mesh("endo"))[0]),
    ]


def test_each_public_object_prints_in_a_few_lines(objects):
    for thing in objects:
        lines = repr(thing).splitlines()
        assert 1 <= len(lines) <= AT_MOST and max(map(len, lines)) <= 112, repr(thing)
        assert type(thing).__name__ in lines[0]
        assert not any(word in repr(thing) for word in ("array(", "dtype", "WarningKind", "quadriform.", " object at "))


def test_no_public_class_is_left_out(objects):
    classes = {getattr(qf, name) for name in qf.__all__ if inspect.isclass(getattr(qf, name))}
    assert classes - {type(thing) for thing in objects} == set()


def public_members():
    """Class, name and docstring of each public method and property of a public class, inherited ones too."""
    for cls in (getattr(qf, name) for name in qf.__all__ if inspect.isclass(getattr(qf, name))):
        for name in (name for name in dir(cls) if not name.startswith("_")):
            member = inspect.getattr_static(cls, name)
            if inspect.isroutine(member) or isinstance(member, property):
                yield cls.__name__, name, inspect.getdoc(member) or ""


def test_each_public_method_states_what_it_returns():
    """In one sentence that can be read alone, without the method before it."""
    relative = re.compile(r"(Likewise|These|Those|That|The same(?: (?:in|for|with|as|of|on|at|after)\b|[.,;]))")
    members = list(public_members())
    assert len(members) > 80
    for cls, name, text in members:
        first = text.split("\n\n")[0]
        assert first.endswith((".", ":")) and not relative.match(first), (cls, name, text)


def test_a_fit_prints_its_status_warnings_and_notes(objects):
    text = repr(objects[0])
    assert text.startswith("Fit: ok") and "OUTLIERS: epi: 9 of " in text and "RMS distance" in text
    crossing = replace(objects[0], warnings={WarningKind.FOLDING: "it folds"})
    assert repr(crossing).startswith("Fit: unreliable") and "FOLDING: it folds" in repr(crossing)


def test_warnings_print_as_words():
    assert repr({WarningKind.OUTLIERS: "two"}) == "{'OUTLIERS': 'two'}" and str(WarningKind.OUTLIERS) == "OUTLIERS"


def test_signatures_of_public_functions_read_well():
    """Options are listed by name, and types are words such as ArrayLike, not their definitions."""
    for name in qf.__all__:
        thing = getattr(qf, name)
        parts = vars(thing).values() if inspect.isclass(thing) or inspect.ismodule(thing) else []
        for function in [thing, *parts]:
            home = getattr(thing, "__module__", getattr(thing, "__name__", ""))
            if inspect.isfunction(function) and function.__module__ == home:
                shown = str(inspect.signature(function))
                assert "**" not in shown and "numpy." not in shown and "Union" not in shown, f"{function}: {shown}"
