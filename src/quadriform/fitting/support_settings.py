"""The constants of support, and of whether points are of one surface."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Limits:
    """The constants of support."""

    widest: float = 0.5
    """Largest distance from data of a supported part, in RMS radii of the points: half the width of the widest gap that
    is interpolated. Across a wider one the shape is unknown, and slices so far apart are too few for their usual
    distance to be measured."""
    noise: float = 3.0
    """Standard deviations of the noise within which a point can be from the part of the surface that it measures."""
    at_base: float = 2.0
    """Standard deviations of the noise within which a surface that closes at its base is not distinguished from it."""
    others: int = 2
    """A point with fewer others within the limit is no data, for no other point confirms its position: it may be an
    outlier. Of random points on a surface one in 5,000 has fewer."""
    resolution: int = 32
    """Of the mesh whose triangles are the parts."""
    directions: int = 12
    """Of the grid of directions in which a surface can extend beyond the data: one every eight degrees."""
    at_once: int = 300_000
    """Products of points and directions that are in memory at a time: more leave the cache."""


LIMITS = Limits()


@dataclass(frozen=True)
class OneSurface:
    """The constants of the tests whether points are of one surface."""

    asked: int = 2000
    """Points of an even sample, of which all near pairs are considered."""
    distant: float = 2.25
    """Points farther from all others than this many limits of support are of another cluster: far above the distance
    between slices, which is that limit."""
    least: float = 0.1
    """Least fraction of the points in a cluster that is a body."""
    fewest: int = 100
    """Least number of points in a cluster that is a body."""
    open_angle: float = np.radians(40)
    """Widest empty cone of a closed body of that many points, seen from its centre in units of its axes. That many
    random directions leave 25 degrees empty; half an ellipsoid, such as an end of a body without data in its middle,
    50 degrees."""
    directions: int = 8
    """Resolution of the grid of directions among which the widest empty cone is found."""
    neighbours: int = 16
    """Points of a neighbourhood in which two layers are sought."""
    layer: int = 4
    """Least number of these that are of the smaller layer."""
    split: float = 0.85
    """Least fraction of the variance of 16 neighbours that two layers explain. The best two halves of normal deviates
    explain two thirds, of uniform ones three quarters."""
    thick: float = 0.1
    """Least distance of layers in RMS radii, twice the distance of a poor fit: voxels and noise make thinner ones."""
    layered: float = 0.5
    """Fraction of neighbourhoods with two layers above which the points are of a double wall."""
    deep: float = 1 / 3
    """Depth, as a fraction of the mean thickness of a body, below which points are not of its surface."""
    most: float = 0.1
    """Largest fraction of the points deep inside; outliers everywhere around a body leave less than half of that."""


ONE = OneSurface()
