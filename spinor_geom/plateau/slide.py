"""The slide: which point of Γ each node of ∂Ω is matched with."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.optimize import isotonic_regression


def nearest_increasing(
    s: Float[np.ndarray, " n"], speed: Float[np.ndarray, " n"], bounds: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, " n"]:
    """A non-decreasing slide around the circle near to s, with s_n ≤ s_0 + 1, inside the bounds of each node.

    It is the nearest one (isotonic regression) of the circle cut open at one node.

    Shortening the whole step instead stalls at corners and on noisy curves.

    Args:
        s: parameters of the nodes in order; they may lie in any interval of about length 1.
        speed: |Γ'| at the nodes; the circle is cut where it is largest, where a change of s costs most.
        bounds: lowest and highest s of each node, non-decreasing both.
    """
    if (np.diff(np.append(s, s[0] + 1)) <= 0).any():
        cut = int(np.argmax(speed))
        line = np.concatenate([s[cut:], s[:cut] + 1])
        line = isotonic_regression(line).x
        line = np.minimum(line, line[0] + 1)
        s = np.concatenate([line[len(s) - cut :] - 1, line[: len(s) - cut]])
    return np.asarray(np.clip(s, *bounds.T))
