"""From an image to points in the world: read, segment, isosurface (paper 5)."""
