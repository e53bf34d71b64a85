"""How points become a model: start, superquadric fit, matching, regularity, refinement.

These are the sections 2.3, 3.2, 3.3 and 4 of the paper.

Terms used in this package:

    centred, scaled frame   the origin is the centroid of the points, the unit of length their RMS distance from it (an
                            RMS radius). `Frame.to_local` leads there from the "world", the frame and unit in which the
                            points were given; "local" of a superquadric or a box is its own frame, or s, t, u in it
    foot point, origin      the point of the deformed surface that a data point is compared with; its origin is the
                            point of the undeformed superquadric that the box moves there, and is what is stored
    covariances             what is known of the measurement errors of the points before the fit, (n, 3, 3)
    least_sigma, s0         the known standard deviation of these errors along the normals, as a root mean square; the
                            lower bound of sigma. Covariances divided by s0^2 are called relative
    sigma                   the standard deviation of the residuals of the inliers along the normals, as the fit
                            estimates it: measurement errors and misfit together. With covariances each residual is
                            first divided by the root of its relative variance. `Fit.noise` is sigma in the unit of the
                            points
    strength                alpha, the weight of the regulariser per data point; lambda is alpha times their number
    evidence                the marginal likelihood: the probability of the data with the control points integrated out
    independent points      points count as fewer where the errors of neighbours are correlated: the effective number of
                            independent points, or `effective_fraction` of all. It changes the evidence and the
                            uncertainty, not the weights of the points
    round                   one update of foot points, inlier probabilities and control points
    stage                   rounds on the same points with the same number of control points
    start                   superquadrics, one for each surface, from which a refinement begins
    covered                 data covers a surface that it samples without gaps, or as far as its base
    certified               a map is verified not to fold inside the surfaces, and the surfaces do not cross
"""
