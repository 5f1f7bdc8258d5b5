"""Distance of an estimate from its reference, and how fast it falls: what every comparison here measures."""

import numpy as np
from numpy.typing import ArrayLike


def relative_error(estimate: ArrayLike, reference: ArrayLike) -> float:
    """Relative L2 error ‖estimate − reference‖₂/‖reference‖₂ over all elements.

    Raises ValueError for shapes that differ (nothing is broadcast), values that are not finite, and a reference that
    is zero throughout. Blind to where an error sits: a short burst in a long signal weighs little.
    """
    estimate, reference = np.asarray(estimate, dtype=float), np.asarray(reference, dtype=float)
    if estimate.shape != reference.shape:
        raise ValueError(f"estimate has shape {estimate.shape}, reference {reference.shape}")
    if not (np.all(np.isfinite(estimate)) and np.all(np.isfinite(reference))):
        raise ValueError("estimate and reference must be finite")
    norm = np.linalg.norm(reference)
    if norm == 0:
        raise ValueError("the reference is zero: no error is relative to it")
    return float(np.linalg.norm(estimate - reference) / norm)


def slope(x: ArrayLike, errors: ArrayLike) -> float:
    """Exponent s of errors ≈ c xˢ, by least squares on log errors against log x.

    Parameters
    ----------
    x : (N,) positive, at least two different values: amplitude or time step.
    errors : (N,) positive.

    Raises ValueError for anything else. Breaks where errors are rounding (too small an x) or not yet asymptotic (too
    large): a mean slope is returned all the same.
    """
    x, errors = np.asarray(x, dtype=float), np.asarray(errors, dtype=float)
    if x.ndim != 1 or x.shape != errors.shape:
        raise ValueError(f"x and errors must be one-dimensional and of one length, not {x.shape} and {errors.shape}")
    if not (np.all(np.isfinite(x) & (x > 0)) and np.all(np.isfinite(errors) & (errors > 0))):
        raise ValueError("x and errors must be positive and finite")
    if np.unique(x).size < 2:
        raise ValueError("a slope needs at least two different x")
    centred = np.log(x) - np.mean(np.log(x))
    return float(centred @ np.log(errors) / (centred @ centred))
