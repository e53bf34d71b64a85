"""The constants of the search for the best strength (`marginal_likelihood.py`)."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Selection:
    """The constants of the search for the strength; steps and tolerances are in its logarithm."""

    widest: tuple[float, float] = (1e-13, 1e3)
    """Range of strengths of the first search, in steps of a decade: from no regularisation to an affine map."""
    search_factor: float = 30.0
    """A later search stays within this factor of the strength at which it starts."""
    coarse_tolerance: float = 0.1
    """Tolerance of the derivative-free minimisation. The root of the derivative is found from there, for rounding of
    the data may change the result of the minimisation by this much."""
    most_steps: int = 8
    """Secant steps to the root; where they do not converge, the minimum is sought without derivatives."""
    tolerance: float = 1e-6
    """Length of the last secant step to the root; what is left is of higher order."""
    iteration_tolerance: float = 0.03
    """Length of the last step within the rounds of a fit: the next round continues from there."""
    flat_derivative: float = 0.02
    """The criterion is flat where its derivative by the logarithm of the strength is below this: where an
    affine map fits the data, the criterion decreases for ever with the strength, and its derivative tends to zero."""
    equal_criteria: float = 0.01
    """Criteria that differ by less are equally good in the first search."""
    sigma_floor: float = 1e-9
    """Least standard deviation: the logarithm of the variance stays finite where a fit is exact."""
    null_space_weight: float = 1e-12
    """Added to the diagonal on the null space of K1, relative to the largest diagonal entry of A: a displacement there
    that no point determines becomes zero."""


SELECTION = Selection()
