"""Boxes of parameters from rows with bounded uncertainty, with their proofs.

    |Y + R theta| <= w0 + W |theta|

holds row by row for the unknown theta: Y and R are known within w0 and W, as where each row is a
measurement with errors in both its value and its coefficients. The tools here find a box that
holds every such theta, and an argument for it that is checked without any solver:

- :func:`parameter_box`: linear programs over the signs of theta (rows one by one);
- :func:`direction_box`: a finite box where these give none, from the uncertain numbers that rows
  share (:class:`CoupledRows`);
- :func:`lifted_box` and :func:`complete_box`: rows in products of parameters
  (:class:`ProductRows`).

What comes out is checked by ``box.verify(...)``; the checks are in
:mod:`sparsepop_py.verified.uncertain_rows` and belong to the trusted kernel.

Examples
--------
A spring law F = k x + c x^3 from forces and strokes that are read within bounds; the regressors x
and x^3 are uncertain as well:

>>> import numpy as np
>>> from sparsepop_py.uncertain_rows import UncertainRows, parameter_box
>>> stroke, force = np.array([0.5, 1.0, 1.5, 2.0]), np.array([1.05, 2.4, 4.35, 7.2])
>>> regressors = np.stack([stroke, stroke**3], axis=1)
>>> radii = np.stack([np.full(4, 0.01), 0.01 * 3 * (stroke + 0.01) ** 2], axis=1)
>>> rows = UncertainRows(("k", "c"), -force, regressors, np.full(4, 0.05), radii)
>>> box = parameter_box(rows)
>>> [bool(low <= true <= high) for low, true, high in zip(box.lower, (2.0, 0.4), box.upper)]
[True, True]
>>> box.verify(rows, np.array([[-np.inf, -np.inf], [np.inf, np.inf]]))
True
"""

from sparsepop_py.uncertain_rows.directions import direction_box, units_of_rows
from sparsepop_py.uncertain_rows.lifted_products import complete_box, lifted_box
from sparsepop_py.uncertain_rows.sign_tree import left_inverse, parameter_box
from sparsepop_py.verified.uncertain_rows.coupled import CoupledRows
from sparsepop_py.verified.uncertain_rows.directions import DirectionBox
from sparsepop_py.verified.uncertain_rows.lifted_products import LiftedBox, lifted_rows
from sparsepop_py.verified.uncertain_rows.products import ProductRows
from sparsepop_py.verified.uncertain_rows.rows import UncertainRows
from sparsepop_py.verified.uncertain_rows.sign_tree import ParameterBox

__all__ = [
    "CoupledRows",
    "DirectionBox",
    "LiftedBox",
    "ParameterBox",
    "ProductRows",
    "UncertainRows",
    "complete_box",
    "direction_box",
    "left_inverse",
    "lifted_box",
    "lifted_rows",
    "parameter_box",
    "units_of_rows",
]
