"""Fits that several tests ask for: the same points with the same options are fitted once for all of them."""

import pickle
from functools import wraps

FOUND = {}
"""From what was given, to the result."""


def remember(patch, module, *names):
    """While the patch holds, functions of a module give the result of before for the same; errors come anew."""
    for name in names:
        patch.setattr(module, name, _remembering(getattr(module, name)))


def _remembering(function):
    @wraps(function)
    def remembered(points, **options):
        told = {name: value for name, value in options.items() if name != "progress"}
        given = function.__qualname__, pickle.dumps((points, told))
        if given not in FOUND:
            FOUND[given] = function(points, **options)
        return FOUND[given]

    return remembered
