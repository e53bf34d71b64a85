"""The default refinement: point-to-plane distances, from few control points to all, without folds.

The entry points are `refine_tangent` and `smooth_box` of `refine.py`. From the parts to the whole, the files are best
read in this order:

1. `surface_data.py` has the data of one surface: its points, their foot points and their inlier probabilities.
2. `point_to_plane.py` has the linear problem of one round, in which the foot points are fixed and the box moves.
3. `base_prior.py` has its prior on the surface beyond a base, where there is no data.
4. `correspondence.py` pairs data points and model points while the surface is still far from the data.
5. `stage.py` makes the rounds at one number of control points, until the surface hardly moves.
6. `left_out.py` finds a smaller strength by cross-validation with patches of the surface.
7. `stages.py` is the sequence of stages, from few control points and few data points to all of them.
8. `unfolding.py` removes folds of the map.
9. `starts.py` proposes the superquadrics from which a refinement starts.
10. `refine.py` tries these starts and returns the best certified refinement.
11. `large_clouds.py` continues a fit to a sample on all points of a very large cloud.
"""
