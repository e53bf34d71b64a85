"""A model that moves: one superquadric in a box whose control points are functions of time.

Each frame of the motion is a model of the paper: Bardinet, Cohen and Ayache, A parametric deformable model to fit
unstructured 3D data, Computer Vision and Image Understanding 1998; 71: 39-54. Its extension to sequences of images is
Bardinet, Cohen and Ayache, Tracking and motion analysis of the left ventricle with deformable superquadrics, Medical
Image Analysis 1996; 1: 129-149. The whole cycle as one problem is ours.

    frame       the points at one time, and that time; F of them. `points.Frame`, a frame of coordinates, is another
                thing: variables of this class are called `normalisation`
    knot        a time at which the splines have their coefficients; K of them
    spline      the function of time that is one at its knot and zero at the others (`shapes/splines.py`); the values of
                all of them at the frames are `splines_at_frames`, (F, K)
    u           time in units of the period, or without one of the time that the knots cover
    displacement  of a control point, from its position in the undeformed box
    alpha, gamma  strengths of the regularisation in space and in time, per data point
    sigma       standard deviation of the inliers' point-to-plane residuals, in RMS radii

`tracking.track` with the strategy "cycle":

1. `frames.py` checks the input; `whole_cycle.smooth_start` takes the superquadrics of one frame, `Task.reference`.
2. It fits this frame alone, with a smooth surface.
3. `affine_start.fitted_motion`, in rounds, maps this box to each frame by affine maps (`cycle_rounds._affine_images`).
4. `cycle.Cycle.step` makes rounds of the whole problem, the linear one of `cycle_equations.py`, at strengths that fall
   to those estimated, and until sigma converges (`cycle_rounds._fitted`). `slice_motions.py` adds rigid motions of
   slices, `slice_prior.py` their prior.
5. `cycle_rounds._unfolded_fit` removes folds; `quality.py` states what the data supports, and warns.

With a prior the steps 2, 3 and 5 are those of `members.py`: the pose of the population in one frame, the members
nearest to the points of each frame, and folds that are removed with the surfaces held. `energies.py` has what the
rounds need of the regularisation in space, of either kind.
"""
