"""The default refinement: point-to-plane distances, from few control points to all, without folds."""
