"""Superquadrics fitted to points: the method of the paper (2.3, A.3), and the robust one that the default starts from.

Lengths are in RMS radii: the points are centred and divided by the RMS distance from their centroid. The equations
P1 to P14 and the sections are those of docs/equations.md.

    F              the inside-outside function (P1): 1 on the surface, smaller inside, larger outside
    P3             the criterion of the paper: the sum of (F - 1)^2 over the points
    d              the signed distance to first order (P4), (F - 1) / |grad F|; negative inside
    relative noise what is known of the measurement: the standard deviation of each point along the normal, divided by
                   the root of the mean variance (`fitting/noise.py`). Distances are divided by it
    sigma          the estimated standard deviation of the inliers' distances: measurement and misfit together. It is
                   the `noise` of the result
    inlier         a point that is more probably of the surface than an outlier, by the mixture of `fitting/mixture.py`.
                   `inliers` are these probabilities; a mask of inliers is an `inlier_mask`
    accepted       a candidate with at least half of the points as inliers whose distances look independent
    exact          points without noise: sigma is rounding
    covered        a surface with points in most directions from its centre
    support        a plane on which the body stands (the option `support`)

The paper's method is `paper.py`. The robust one:

1. `fit.py` checks the options and makes the `SearchProblem` (`problem.py`) of the distinct points.
2. `multistart.py` searches: starts of `initial.py` are compared on samples by descents (`levenberg_marquardt.py`) of
   their parameters (`candidates.py`) and of the mixture of inliers and outliers.
3. `restarts.py` makes further starts for bodies with points on one side; `empty_space.py` penalises surfaces where the
   sensor saw nothing or beyond the support (`surroundings.py`).
4. `identifiability.py` and `covariance.py` state how well the points determine the parameters, `diagnostics.py` warns.
"""
