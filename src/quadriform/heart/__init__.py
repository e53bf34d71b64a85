"""What a cardiologist reads off a model: volumes, ejection fraction, wall, strain, twist, segments.

The points of a ventricle that a model is fitted to come from images by `imaging/ventricle.py`.
"""
