"""`fit` for points, meshes and files; Python and the command line use the same functions."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from quadriform.errors import OptionError, choose, join_warnings
from quadriform.files.metadata import SPACES
from quadriform.files.reading import PathLike, sha256_of
from quadriform.fitting import fit as fitting
from quadriform.fitting.result import Fit
from quadriform.imaging.file_points import (
    ReadOptions,
    Source,
    common_space_and_unit,
    files_of,
    input_files,
    read_source,
    title_of,
    without_folders,
)
from quadriform.point_sets import ALONE
from quadriform.shapes.landmarks import BasePlane
from quadriform.shapes.mesh import Mesh

Input = ArrayLike | Mesh | PathLike | Mapping[str, ArrayLike | Mesh] | Mapping[str, PathLike]
Files = Mapping[str, tuple[Path, ReadOptions]]
"""Surface name -> file and how to read it."""


@wraps(fitting.fit, assigned=())
def fit(points: Input, **options: Any) -> Fit:
    """Return the fit of a superquadric that is refined by a free-form deformation.

    Of more than 50,000 points a sample is fitted first, then all of them, a part at a time.

    Args:
        points: (n, 3) points around a body in any unit and frame; or a triangle mesh, of which the points are spread
            over its area unless its vertices are dense; or the path of a file of points, a mesh or an image, read as
            `quadriform fit` reads it. Several of these by name share one control box, that of the outermost. Of a
            structured array or a data frame the columns named x, y and z are taken, with the normals nx, ny, nz and
            the unit in the names, such as "x [mm]".
        kind: of superquadric: "ellipsoid" (any superellipsoid), "toroid", "hyperboloid1" or "hyperboloid2".
        method: "tangent": our most accurate method, by distances to tangent planes; "paper": Bardinet, Cohen and
            Ayache 1998.
        box: control points along each axis, from 2 to 20; or "auto": the smallest box that reaches `max_error`.
        regularity: the regulariser. For method "tangent" "bending" (default: the bending energy of the deformation),
            "springs", or an object with one method `matrix(shape)`, (n, n) over control points. For "paper" "svd"
            (default: P7 by SVD), "springs-paper" (P9 as printed), or our variations "springs" and an object (on the
            displacement) and "svd-position".
        strength: regularisation weight alpha per data point (for "paper" per model point), or "auto": that of the
            largest marginal likelihood or, where residuals are correlated, a smaller one that predicts left-out patches
            of the surface better. For "svd" how many singular values are used (>= 1), or the smallest fraction of the
            largest (< 1); "auto": all above rounding.
        robust: only for "tangent": whether outliers are detected and down-weighted; True unless given.
        base: only for "tangent": where the data ends on purpose, a plane (point, direction to the side without data)
            or a loop (m, 3) of points along the edge.
        viewpoint: only for "tangent": position (3,) of the sensor, or for each point (n, 3) where it was seen from, or
            these by name, in the unit and frame of the points. The superquadric is kept out of the space that the
            sensor saw to be empty: in front of what it measured, and in directions in which it measured nothing.
            Positions that fewer than 100 points have in common are not used.
        support: only for "tangent": the supporting plane (point, normal), such as a table, which the superquadric does
            not pass; the body is on the side of most points. `Fit.supported` is something else: how much of the surface
            data covers.
        max_error: only for box="auto": the RMS distance to the inliers to reach, in the unit of the points.
        matching: only for "paper": "data-to-model" (default) or "model-to-data".
        iterations: only for "paper": the largest number of iterations; 30 unless given.
        tolerance: only for "paper": stop when the surface moves by less, as a fraction of the RMS radius of the
            points; unless given all iterations are made.
        weights: (n,) >= 0, or by name; a point of weight k counts as k points. Not for meshes and files.
        noise: only for "tangent": what is known of the error of the points, in their unit: a standard deviation, one
            for each point (n,), or covariances (n, 3, 3), or these by name. Distances are measured by it, and the
            estimated noise is at least as large. A covariance may be of rank one, for an error along a ray or along the
            edge of a voxel. Masks have theirs from the size of their voxels. Not for meshes and files.
        prior: only for "tangent": a `ShapePrior`, as of `learn_prior` or `load`, of the same surfaces: pose and shape
            are those of a member of its population, estimated together, with its own superquadrics, box and weights.
            Where there is no data the surface is that of the population.
        progress: called with (steps done, about how many).
        columns: which columns are which, where the names do not say it, such as "x,y,z,nx,ny,nz" for (n, 6).
        normals: (n, 3), or by name, in place of those in columns; signs may be arbitrary, zero means none. Not for
            files.
        unit: of the points, "mm" or "m", which the model is marked with; that of the columns or the file unless given.
        space: frame of the world of the points, "LPS", "RAS" or "unknown", which the model is marked with; that of the
            file where it has one.

    Raises:
        PointsError, DegenerateError, OptionError: the input cannot be fitted.
        InputError, FileFormatError, FileLimitError: a file gives no points; a prior of other surfaces, or in another
            unit or frame.
    """
    given = dict(options)
    paths = _path_by_name(points)
    if not paths:
        return fitting.fit(points, **given)  # type: ignore[arg-type]  # no paths are left
    for name in ("weights", "normals", "noise"):
        if given.pop(name, None) is not None:
            raise OptionError(f"{name}: go with points, found files; read them with read_points first")
    reading = ReadOptions(columns=given.pop("columns", None), unit=given.pop("unit", None))
    space = choose(given.pop("space", "unknown"), SPACES, "space")
    files = {name: (path, reading) for name, path in paths.items()}
    sources = {name: _with_stated_space(read_source(path, reading), path, space) for name, path in paths.items()}
    found = fit_sources(files, sources, given)
    notes = without_folders([n for source in sources.values() for n in source.notes], _paths(files))
    return replace(found, notes=(*notes, *found.notes))


def _with_stated_space(source: Source, path: Path, space: str) -> Source:
    """The points, as they are, with the frame of the world that the caller states where the file states none."""
    if space != "unknown" and source.space not in (space, "unknown"):
        raise OptionError(f"option space={space!r} contradicts {str(path)!r}, which is in {source.space}")
    return source if space == "unknown" else replace(source, space=space)


def fit_sources(files: Files, sources: Mapping[str, Source], options: Mapping[str, Any]) -> Fit:
    """Return the fit of points from files, with space, unit, hash and names of the files, all warnings, and estimates.

    Args:
        files: surface name -> file and how it was read.
        sources: surface name -> points.
        options: of `quadriform.fitting.fit.fit`.

    Raises:
        InputError: the surfaces differ in space or unit.
        PointsError, DegenerateError, OptionError: the input cannot be fitted.
    """
    space, unit = common_space_and_unit(sources)
    clouds = {name: source.cloud for name, source in sources.items()}
    alone = clouds.keys() == {ALONE}
    found = fitting.fit(clouds[ALONE] if alone else clouds, **options)
    paths = _paths(files)
    each = (input_files({"" if alone else name: [path]}, reading.frame) for name, (path, reading) in files.items())
    inputs = tuple(file for part in each for file in part)
    record = replace(found.model.record, title=title_of(paths, most=len(paths)), sources=inputs)
    sha256 = sha256_of(*(file for path in paths for file in files_of(path)))
    model = replace(found.model, space=space, unit=unit, input_sha256=sha256, record=record)
    warnings = join_warnings(*(source.warnings for source in sources.values()), found.warnings)
    return replace(found, model=model, warnings=warnings).with_estimates()


def with_base(options: Mapping[str, Any], base: BasePlane | None) -> dict[str, Any]:
    """Return the options of a fit with the base of a ventricle; the paper's method has none, its points end there."""
    if base is None or options.get("method") == "paper":
        return dict(options)
    # plain numbers, which pages list
    return {**options, "base": (base.point.tolist(), base.direction.tolist())}


def _path_by_name(points: Any) -> dict[str, Path]:
    """The files by name of the surface; empty where no paths were given.

    Raises:
        OptionError: some are paths and some are not.
    """
    named = points if isinstance(points, Mapping) else {ALONE: points}
    paths = {str(name): Path(each) for name, each in named.items() if isinstance(each, str | os.PathLike)}
    if paths and len(paths) != len(named):
        raise OptionError(f"points: expected files for all surfaces or for none, found files for {', '.join(paths)}")
    return paths


def _paths(files: Files) -> list[Path]:
    """The files, each once."""
    return list(dict.fromkeys(path for path, _ in files.values()))
