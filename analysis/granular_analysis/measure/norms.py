"""Relative error of an estimate against its reference, and the order at which errors converge."""

import numpy as np
from numpy.typing import ArrayLike


def relative_error(estimate: ArrayLike, reference: ArrayLike) -> float:
    """Return the relative L2 error ‖estimate − reference‖₂/‖reference‖₂ over all elements of two equal shapes.

    Raises ValueError for different shapes (nothing is broadcast), values that are not finite, and a reference that is
    zero throughout. When it breaks: a short burst of error in a long signal weighs little.
    """
    estimate, reference = np.asarray(estimate, dtype=float), np.asarray(reference, dtype=float)
    if estimate.shape != reference.shape:
        raise ValueError(f"estimate has shape {estimate.shape}, reference {reference.shape}")
    if not (np.all(np.isfinite(estimate)) and np.all(np.isfinite(reference))):
        raise ValueError("estimate and reference must be finite")
    norm = np.linalg.norm(reference)
    if norm == 0:
        raise ValueError("the reference is zero, so a relative error is undefined")
    return float(np.linalg.norm(estimate - reference) / norm)


def slope(x: ArrayLike, errors: ArrayLike) -> float:
    """Return the exponent s of errors ≈ c xˢ, by least squares on log errors against log x.

    Parameters
    ----------
    x : (N,) positive, with at least two different values, such as amplitudes or time steps.
    errors : (N,) positive.

    Raises ValueError for other shapes or values. When it breaks: if x is so small that errors are rounding, or so large
    that they are not yet asymptotic, the mean slope is returned without a warning.
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
