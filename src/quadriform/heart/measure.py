"""The measures of a beating heart: the public function `measure`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from quadriform.errors import OptionError, PointsError, Warnings
from quadriform.heart.aha_segments import AhaSegmentation
from quadriform.heart.axis import LongAxis, Planes, base_planes, long_axis
from quadriform.heart.base import Base, BaseRule, base_rule
from quadriform.heart.deviations import Models, RowsOf, curve_deviations, with_deviations
from quadriform.heart.heart_cycle import OF_CURVES, OF_SAMPLES, HeartCycle, check_cycle
from quadriform.heart.measures_table import Measures, Row
from quadriform.heart.volumes import DENSITY, section
from quadriform.heart.wall import Wall
from quadriform.heart.wall_motion import ReferenceWall
from quadriform.heart.wall_rows import wall_between, wall_curves, wall_rows
from quadriform.points import Array, unit_vectors
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.mesh import Mesh
from quadriform.shapes.model import DeformableModel
from quadriform.shapes.record import OBSERVED, together

CUTS = 12
"""Planes through the long axis in which contours are measured."""
CONTOURS = "change of length from ED to ES per length, of the endocardial contours in long-axis planes"


def measure(
    models: Sequence[DeformableModel] | DeformableModel,
    times: ArrayLike | None = None,
    *,
    base: Base = None,
    rv_inserts: ArrayLike | Sequence[ArrayLike] | None = None,
    ed: int | None = None,
    observed: bool = False,
) -> Measures:
    """Return measures of a beating heart: volumes, ejection fraction, mass, wall thickness, twist, strain, segments.

    Args:
        models: one a frame in the order of time, with the surfaces "endo" and "epi", or the cavity alone. Twist,
            strain and thickening need frames that share superquadrics and undeformed box.
        times: (F,) increasing, in any unit; the frames' numbers unless given.
        base: the end of the cavity. None: the base that the models were stored with, as those of `quadriform fit
            --heart` and of contours are; without one the closed surface. A number: this fraction of the long axis from
            the apex. (point, direction to the side cut off): a fixed plane. Mitral points (n, 3): their plane, in all
            frames. A list of mitral points, one set a frame: each frame's own plane.
        rv_inserts: (n, 3) points at end diastole where the right ventricle meets the left, anterior and inferior. A
            list of such points, one set a frame: those of end diastole are taken, if there are any. None: those that
            the models were stored with.
        ed: frame of end diastole; the one of the largest volume unless given. End systole has the smallest volume.
        observed: whether the models were fitted to tracked material points. Contours and surfaces have none: twist,
            circumferential strain and all components of Green's strain are then determined by the regularisation only,
            and reported as "not observed".

    Raises:
        OptionError, PointsError, DegenerateError: no cavity, swapped surfaces, times that do not increase, a base that
            leaves nothing, insertions that determine no septum, a frame that does not exist.
    """
    frames = check_cycle(models, times)
    warnings = dict(frames.warnings)
    rule = base_rule(base, frames.models, warnings)
    planes = base_planes(frames, rule, warnings)
    volumes = _volumes(frames, planes)
    cycle = _Cycle(frames, rule, planes, volumes, *_ed_and_es(volumes, ed))
    inserts = None if rv_inserts is None else _inserts_at(rv_inserts, cycle.ed, len(frames.models))
    rows = _rows(cycle, _wall(cycle, warnings), inserts, observed, warnings)
    rows = with_deviations(rows, *_phases(cycle, inserts, observed))
    curves = _curves(cycle, _wall(cycle, {}), warnings)
    fit = together({f"frame {number}": model.record for number, model in enumerate(frames.models)})
    sd = {} if cycle.es is None else curve_deviations(frames.models, cycle.coarse_volumes)
    return Measures(tuple(rows), warnings, frames.times, curves, cycle.ed, cycle.es, fit, planes, sd)


@dataclass(frozen=True)
class _Cycle:
    """The models with their bases and volumes.

    Attributes:
        frames: the models.
        rule: of the base.
        planes: the base of each frame.
        volumes: (F,), of the cavity below its base, in ml.
        ed: frame of end diastole.
        es: frame of end systole; None where there is one frame.
    """

    frames: HeartCycle
    rule: BaseRule
    planes: Planes
    volumes: Array
    ed: int
    es: int | None

    def phases(self) -> _Cycle:
        """The frames of end diastole and end systole alone, for samples of their posterior."""
        numbers = [self.ed] if self.es is None else [self.ed, self.es]
        models = tuple(self.frames.models[number] for number in numbers)
        frames = replace(self.frames, models=models, times=self.frames.times[numbers], resolution=OF_SAMPLES)
        planes = tuple(self.planes[number] for number in numbers)
        es = None if self.es is None else 1
        return _Cycle(frames, self.rule.of_frames(numbers), planes, self.volumes[numbers], 0, es)

    def with_models(self, models: Sequence[DeformableModel]) -> _Cycle:
        """The same frames of end diastole and end systole with other models, whose bases follow the rule."""
        frames = replace(self.frames, models=tuple(models))
        planes = base_planes(frames, self.rule, {})
        return replace(self, frames=frames, planes=planes, volumes=_volumes(frames, planes))

    def coarse_volumes(self, models: Models) -> dict[str, Array]:
        """The curve of the volume by samples of all models, on coarse meshes."""
        frames = replace(self.frames, resolution=OF_CURVES)
        return {"cavity volume": replace(self, frames=frames).with_models(models).volumes}

    def reference(self, wall: Wall, warnings: Warnings) -> ReferenceWall:
        """The wall at end diastole."""
        plane = self.planes[self.ed]
        axis = long_axis(self.frames, self.ed, self.rule, plane, warnings)
        return ReferenceWall.at(wall, self.frames.models[self.ed].box, axis, plane)


def _wall(cycle: _Cycle, warnings: Warnings) -> Wall | None:
    """The wall before deformation; None where there is no epicardium."""
    frames = cycle.frames
    if frames.outer is None:
        return None
    return wall_between(frames.models[cycle.ed].surfaces, frames.resolution, warnings)


def _phases(cycle: _Cycle, rv_inserts: ArrayLike | None, observed: bool) -> tuple[Models, RowsOf]:
    """The models of end diastole and end systole, and what gives the rows of samples of them."""
    phases = cycle.phases()
    wall = _wall(phases, {})

    def rows_of(models: Models) -> list[Row]:
        """The rows of one sample."""
        return _rows(phases.with_models(models), wall, rv_inserts, observed, {})

    return phases.frames.models, rows_of


def _volumes(frames: HeartCycle, planes: Planes) -> Array:
    """Volumes (F,) of the cavity below its base, in ml."""
    return np.array([frames.volume(number, frames.cavity, plane) for number, plane in enumerate(planes)])


def _rows(
    cycle: _Cycle, wall: Wall | None, rv_inserts: ArrayLike | None, observed: bool, warnings: Warnings
) -> list[Row]:
    rows = _volume_rows(cycle)
    if cycle.es is not None:
        # the global longitudinal strain (GLS) as in cine long-axis views, by the length of endocardial contours. It
        # needs no material points, unlike the longitudinal Green strain of the tissue in `wall_rows.py`
        before, after = (_contour_length(cycle, number, warnings) for number in (cycle.ed, cycle.es))
        how = f"{CONTOURS}, {cycle.rule.description}"
        rows.append(Row("longitudinal strain", 100 * (after / before - 1), "%", how))
    if wall is None:
        return rows
    reference = cycle.reference(wall, warnings)
    inserts = _stored_inserts(cycle.frames.models[cycle.ed], reference.axis) if rv_inserts is None else rv_inserts
    return rows + wall_rows(cycle.frames, reference, cycle.ed, cycle.es, inserts, observed, warnings)


def _curves(cycle: _Cycle, wall: Wall | None, warnings: Warnings) -> dict[str, Array]:
    """Quantity -> (F,) over the cycle."""
    curves = {"cavity volume": cycle.volumes}
    if cycle.es is None:
        return curves
    length = np.array([_contour_length(cycle, number, warnings) for number in range(len(cycle.volumes))])
    curves["longitudinal strain"] = 100 * (length / length[cycle.ed] - 1)
    if wall is None or not cycle.frames.material:
        return curves
    return curves | wall_curves(cycle.frames, cycle.reference(wall, warnings))


def _ed_and_es(volumes: Array, given: int | None) -> tuple[int, int | None]:
    """Return the frames of end diastole and end systole."""
    n = len(volumes)
    if given is not None and not 0 <= given < n:
        raise OptionError(f"option ed={given}: there is no such frame; expected 0 to {n - 1}")
    ed = int(volumes.argmax()) if given is None else given
    if n == 1:
        return ed, None
    es = int(volumes.argmin())
    if es == ed:
        raise OptionError(f"option ed={given}: this frame has the smallest volume; expected one before the contraction")
    return ed, es


def _inserts_at(rv_inserts: ArrayLike | Sequence[ArrayLike], frame: int, n_frames: int) -> ArrayLike | None:
    """The insertions at a frame: the given points, or of one set a frame its own."""
    sets: list[ArrayLike] = list(rv_inserts) if isinstance(rv_inserts, Sequence) else []
    if not sets or any(np.ndim(one) != 2 for one in sets):
        return rv_inserts  # type: ignore[return-value]
    if len(sets) != n_frames:
        raise OptionError(f"rv_inserts: expected points for each of {n_frames} frames, found {len(sets)} sets")
    return sets[frame] if np.size(sets[frame]) else None


def _stored_inserts(model: DeformableModel, axis: LongAxis) -> Array | None:
    """The insertions that a model was stored with; None where they determine no septum, for the user gave none."""
    found = model.landmarks.rv_inserts
    try:
        AhaSegmentation.anchored(axis, found)
    except (OptionError, PointsError):
        return None
    return found


def _contour_length(cycle: _Cycle, number: int, warnings: Warnings) -> float:
    """Length of the endocardium's longitudinal contours in a frame, in the unit of the data."""
    plane = cycle.planes[number]
    axis = long_axis(cycle.frames, number, cycle.rule, plane, warnings)
    return contour_length(cycle.frames.cavity_mesh(number), axis, plane)


def contour_length(mesh: Mesh, axis: LongAxis, base: BasePlane | None) -> float:
    """Return the mean length of the contours in 12 planes through the long axis, from base over apex to base.

    Args:
        mesh: of a closed surface.
        axis: the long axis of that frame.
        base: the plane at the base of that frame; None: the whole closed contour.
    """
    total = 0.0
    for across in _directions(axis):
        segments = section(mesh, BasePlane(axis.apex, across))
        lengths = np.linalg.norm(segments[1] - segments[0], axis=1)
        total += float(lengths @ _fractions_below(segments, base))
    return total / CUTS


def _fractions_below(segments: Array, base: BasePlane | None) -> Array:
    """The fraction (m,) of each segment that lies below the base."""
    if base is None:
        return np.ones(segments.shape[1])
    # heights along a segment are linear
    low, high = np.sort([base.heights(ends) for ends in segments], axis=0)
    return np.clip(-low / np.maximum(high - low, 1e-300), 0, 1)


def _directions(axis: LongAxis) -> Array:
    """Unit vectors (CUTS, 3) across the axis, evenly over half a revolution."""
    # the coordinate axis that is least along the long axis has the longest component across it
    first = unit_vectors(axis.across(np.eye(3))[np.abs(axis.direction).argmin()])
    angles = np.pi * np.arange(CUTS)[:, None] / CUTS
    return np.cos(angles) * first + np.sin(angles) * np.cross(axis.direction, first)


def _volume_rows(cycle: _Cycle) -> list[Row]:
    frames, rule, planes, volumes = cycle.frames, cycle.rule, cycle.planes, cycle.volumes
    ed, es = cycle.ed, cycle.es
    diastole = f"frame {ed} at {frames.times[ed]:g}"
    rows = [Row("end-diastolic volume", float(volumes[ed]), "ml", f"{diastole}, {rule.description}")]
    if es is not None:
        rows += _ejection_rows(volumes[[ed, es]], f"frames {ed} and {es}, {rule.description}", "")
    if planes[ed] is not None:
        parts = [number for number in (ed, es) if number is not None]
        closed = np.array([frames.volume(number, frames.cavity, None) for number in parts])
        words = "whole closed surface, beside the one below the base"
        whole = [Row("end-diastolic volume, closed", float(closed[0]), "ml", f"{diastole}, {words}")]
        if es is not None:
            whole += _ejection_rows(closed, f"frames {ed} and {es}, {words}", ", closed")
        rows += _observed_where_supported(whole, frames)
    if frames.outer is not None:
        # muscle is the volume between endocardium and epicardium
        enclosed = frames.volume(ed, frames.outer, planes[ed])
        how = f"{DENSITY:g} g/ml times the volume between the surfaces, {diastole}, {rule.description}"
        rows.append(Row("myocardial mass", DENSITY * (enclosed - float(volumes[ed])), "g", how))
    return _observed_where_supported(rows, frames) if planes[ed] is None else rows


def _observed_where_supported(rows: list[Row], frames: HeartCycle) -> list[Row]:
    """Rows about whole closed surfaces, not observed where data does not support these in some frame."""
    recorded = [part for model in frames.models for part in model.record.supported.values()]
    least = min(recorded, default=OBSERVED)
    if least >= OBSERVED:
        return rows
    about = f"not observed, data supports {100 * least:.0f} % of the surface"
    return [replace(row, how=f"{about}: {row.how}", observed=False) for row in rows]


def _ejection_rows(pair: Array, how: str, suffix: str) -> list[Row]:
    """End-systolic and stroke volume and ejection fraction from both volumes (2,) in ml."""
    before, after = (float(value) for value in pair)
    return [
        Row(f"end-systolic volume{suffix}", after, "ml", how),
        Row(f"stroke volume{suffix}", before - after, "ml", how),
        Row(f"ejection fraction{suffix}", 100 * (before - after) / before, "%", how),
    ]
