"""How much noise the points of a part program carry.

Points of a smooth curve lie close to the cubic through their four neighbours; rounding and measuring noise do not.  With
chord length as parameter and Lagrange weights w_k, the residual across the path

    r = n . (p_i - sum_k w_k p_k),     variance (1 + sum_k w_k^2) sigma^2,

gives sigma by its median, and the amplitude sqrt(3) sigma of an error that is uniform within +- amplitude, as rounding is.
The smooth part leaves r of the order of the fourth derivative times the fourth power of the spacing, so that coarse points
raise the estimate: it is one from above.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from planner.types import FloatArray

_MEDIAN = 1.4826  # sigma over the median of |r| of a normal distribution
_FEWEST = 20  # residuals that make an estimate


def noise_amplitude(points: FloatArray, smooth: NDArray[np.bool_]) -> float:
    """Estimate the amplitude of the noise across a polyline.

    Parameters
    ----------
    points : (n, dim) array
        Vertices, mm, neighbours apart.
    smooth : (n,) bool array
        Vertices inside runs of short blocks; a residual is taken where a vertex and two on either side are such.

    Returns
    -------
    float
        mm; 0 where there are too few of them.
    """
    inner = smooth[2:-2] & smooth[1:-3] & smooth[:-4] & smooth[3:-1] & smooth[4:]
    at = 2 + np.flatnonzero(inner)
    if at.size < _FEWEST:
        return 0.0
    chord = np.sqrt(np.sum(np.diff(points, axis=0) ** 2, axis=1))
    s = np.concatenate([[0.0], np.cumsum(chord)])
    offsets = np.array([-2, -1, 1, 2])
    x = s[at[:, None] + offsets] - s[at][:, None]
    weights = np.ones_like(x)
    for k in range(4):
        for j in range(4):
            if j != k:
                weights[:, k] *= -x[:, j] / (x[:, k] - x[:, j])
    residual = points[at] - np.einsum("nk,nkd->nd", weights, points[at[:, None] + offsets])
    along = points[at + 1] - points[at - 1]
    along /= np.sqrt(np.sum(along**2, axis=1))[:, None]
    across = residual - along * np.sum(residual * along, axis=1)[:, None]
    size = np.sqrt(np.sum(across**2, axis=1) / (1.0 + np.sum(weights**2, axis=1)))
    return float(np.sqrt(3.0) * _MEDIAN * np.median(size))
