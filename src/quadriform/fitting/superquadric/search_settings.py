"""The constants of the multi-start search of the robust superquadric."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SearchSettings:
    """Numbers of points, steps and candidates, tolerances and limits; lengths in RMS radii."""

    density_points: int = 1500
    """Points of the largest sample, from which the density is estimated: enough for 9 neighbours to be near."""
    fine: int = 500
    """Points on which the best candidates are compared."""
    coarse: int = 160
    """Points on which all candidates of the narrow search are tried: a dozen for each parameter."""
    coarse_wide: int = 320
    """Points on which those of the wide search are tried, whose parts have only some of them."""
    own_steps: int = 4
    """Steps on the part of the cloud from which a start was made: it moves to that part, and no further."""
    annealing_steps: int = 8
    """Steps while sigma is lowered to a tenth of its first value."""
    em_steps: int = 6
    """Steps with an estimated sigma, until candidates can be compared."""
    compare_steps: int = 8
    """Steps of the comparison on more points."""
    maybe_exact_steps: int = 16
    """Steps with all points as inliers, which must converge to `exact`."""
    growth: int = 16
    """Factor between the sizes of successive samples, until all points are in one."""
    kept: int = 4
    """Distinct candidates that are kept on the larger sample after the narrow search."""
    kept_wide: int = 8
    """Those that are kept after the wide search, which finds more, of a round of the search through all points, and of
    the best candidates among which alternatives are sought."""
    final_tolerance: float = 1e-10
    """The last descent has converged when a step changes less than this. For all
    tolerances of steps the change is the largest one of a parameter, or the largest one of a distance in units of sigma
    where that is less (`Descent._change`)."""
    damped_tolerance: float = 1e-2
    """Damped steps end when they change less than this; undamped, accelerated steps follow."""
    comparison_tolerance: float = 1e-4
    """Candidates that change less than this in a step can be compared."""
    sample_steps: int = 15
    """Most steps on a sample of the points: the next one begins near its minimum."""
    sample_tolerance: float = 1e-6
    """The tolerance of these."""
    exact_rounds: int = 3
    """Rounds of the search for a surface through all points: in the axes of the cloud, and twice in those found."""
    elsewhere: float = 1e-6
    """Weight of the points of other parts, so that every problem has full rank."""
    majority: float = 0.5
    """Least inlier ratio of an accepted candidate."""
    crease_tolerance: float = 1e-6
    """The tolerance at a crease, where derivatives are discontinuous and no descent converges."""
    most_steps: int = 40
    """Most steps of one descent, more than convergence takes where there is a minimum."""
    least_independent: float = 0.5
    """Least half of von Neumann's ratio in an accepted candidate: the part of the variance of the distances that is
    not common to neighbours; see `acceptable`."""
    acceptance_bonus: float = 0.1
    """Log likelihood per point that is added to that of accepted candidates in a comparison with others."""
    exact: float = 1e-6
    """Noise below this is rounding, of data in single precision too."""
    maybe_exact: float = 0.02
    """Sigma of the best surface above which points are not exact: near exact ones even a wrong surface has less."""
    alternative: float = 0.01
    """Surfaces whose cost, sigma squared, is within this fraction of the best are alternative minima."""
    first_sigma: float = 0.5
    """Largest sigma at the start of annealing, as a fraction of the RMS semi-axis of a start from a part of the cloud;
    in RMS radii of the cloud for starts from all of it."""
    never: float = -100.0
    """Log odds of a point that is of another body."""
    same: float = 0.5
    """Surfaces nearer to each other than this many sigma at the points are one."""


SEARCH = SearchSettings()
