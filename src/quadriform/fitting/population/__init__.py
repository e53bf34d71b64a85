"""Fits with a prior of shape: the pose and the shape of a member of a population, estimated together.

The unknowns are the displacements u of the control points of the prior's box, which is placed by a pose (rotation,
shift, and size where the prior asks for it). In each round they minimise the distances of the data to tangent planes
and the prior's (u - m)' Q (u - m), with m the mean. Rigid motions of the mean shape cost nothing: the linear problem
has them besides the shape, and after a few rounds they become part of the pose (`fit.py`).

- `poses.py`: where the rounds begin: the mean shape placed by many rotations, then pose and modes alone
- `coordinates.py`: the prior in coordinates in which what is outside of its modes is alike in all directions
- `linear_problem.py`: the linear problem of a round, and the weights of the prior by the marginal likelihood
- `given_surfaces.py`: a map without folds that has the surfaces found
- `fit.py`: the rounds, and the result
"""
