"""Linear rows with bounded uncertainty: |Y + R theta| <= w0 + W |theta|."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.algebra.read_only import ReadOnly
from sparsepop_py.errors import ProblemError

__all__ = ["UncertainRows"]

Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class UncertainRows(ReadOnly):
    """Rows |target + regressors theta| <= radius + radii |theta|, which every theta obeys.

    Row k is y_k + r_k' theta = 0 where y_k is known within ``radius[k]`` and each entry of r_k
    within its entry of ``radii``. Arrays are copied, checked and made read-only.

    Parameters
    ----------
    names : tuple of str
        The parameters, in the order of theta.
    target : (R,) float
        What is known of each row without theta (Y).
    regressors : (R, p) float
        What multiplies theta (R).
    radius : (R,) float
        Uncertainty without theta (w0), not negative.
    radii : (R, p) float
        Uncertainty for each unit of abs(theta) (W), not negative.

    Raises
    ------
    ProblemError
        If shapes do not fit, numbers are not finite or an uncertainty is negative.

    Examples
    --------
    >>> import numpy as np
    >>> rows = UncertainRows(("m",), [-2.0], [[1.0]], [0.1], [[0.05]])  # (1 +- 0.05) m = 2 +- 0.1
    >>> rows.margin(np.array([2.0])).round(3), rows.margin(np.array([3.0])).round(3)
    (array([0.2]), array([-0.75]))
    """

    names: tuple[str, ...]
    target: Reals
    regressors: Reals
    radius: Reals
    radii: Reals

    def __post_init__(self) -> None:
        target = np.array(self.target, float)
        shapes = {"target": target.shape[:1] if target.ndim else (1,)}
        shapes["radius"] = shapes["target"]
        shapes["regressors"] = shapes["radii"] = (*shapes["target"], len(self.names))
        for field, shape in shapes.items():
            values = np.array(getattr(self, field), float)
            if values.shape != shape:
                raise ProblemError(f"{field}: found shape {values.shape}, expected {shape}")
            if not np.all(np.isfinite(values)):
                raise ProblemError(f"{field}: found a number that is not finite")
            if field in ("radius", "radii") and np.any(values < 0.0):
                raise ProblemError(f"{field}: found a negative uncertainty, expected numbers >= 0")
            values.flags.writeable = False
            object.__setattr__(self, field, values)

    def margin(self, theta: Reals) -> Reals:
        """Subtract the left side of each row from its right side.

        Parameters
        ----------
        theta : (p,) float

        Returns
        -------
        (R,) float
            Negative where theta violates a row.
        """
        width = self.radius + self.radii @ np.abs(theta)
        return np.asarray(width - np.abs(self.target + self.regressors @ theta), np.float64)
