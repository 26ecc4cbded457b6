"""Block structures: Hammerstein, Wiener, Lur'e, Hammerstein-Wiener, and the general form.

The named ones are instances of :class:`BlockStructured` with one linear block.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from setid.errors import ModelError
from setid.models.equations import Initial
from setid.models.general import BlockStructured, Normalise
from setid.models.lti import Form, TransferFunction
from setid.models.maps import StaticMap

__all__ = [
    "BlockStructured",
    "Hammerstein",
    "HammersteinWiener",
    "Lure",
    "StaticMap",
    "Wiener",
]


class Hammerstein(BlockStructured):
    """A static nonlinearity at the input: w = sum_m gamma_m phi_m(u), y = G w.

    Parameters
    ----------
    linear : TransferFunction
        Orders of G, such as ``TransferFunction(na=2, nb=2, nk=1)``.
    basis : int or sequence
        Powers u, ..., u^M, or entries of :class:`StaticMap`.
    normalise : optional
        ``"dcgain"``: static gain of G is 1; ``"gamma1"`` or another parameter: fixed to 1;
        ``{"gamma1": 2.0}``: fixed to a number; None: none, and :func:`setid.identify` refuses.
    initial, form
        As for :class:`BlockStructured`.

    Notes
    -----
    (G, N) and (G / k, k N) have the same output for every k != 0: numerator coefficients
    are divided by k, all gamma multiplied by it. Static gain 1 takes k = G(1), gamma1 = 1
    takes k = 1 / gamma1: unique where G(1), gamma1 are not zero.

    References
    ----------
    V. Cerone, D. Regruto, "Parameter bounds for discrete-time Hammerstein models with
    bounded output errors", IEEE Trans. Automatic Control 48 (2003) 1855-1860.

    Examples
    --------
    >>> import setid
    >>> setid.Hammerstein(setid.TransferFunction(1, 2, 1), 3, normalise="gamma1").parameters
    ('a1', 'b1', 'b2', 'gamma2', 'gamma3')
    """

    __slots__ = ()

    def __init__(
        self,
        linear: TransferFunction,
        basis: int | Sequence[Any],
        normalise: Normalise = None,
        initial: Initial = "free",
        form: Form = "auto",
    ) -> None:
        maps = {"w": StaticMap("u1", basis)}
        super().__init__(
            {("y1", "w"): linear}, maps, normalise=normalise, initial=initial, form=form
        )


class Wiener(BlockStructured):
    """A static nonlinearity at the output: z = G u, y = sum_m gamma_m z^m.

    Parameters
    ----------
    linear : TransferFunction
        Orders of G.
    basis : int or sequence of int
        Powers of z.
    normalise : optional
        ``"dcgain"``: static gain of G is 1; ``"b1"`` or another numerator coefficient: 1;
        ``"gamma1"``: 1; None: none, and :func:`setid.identify` refuses.
    initial, form
        As for :class:`BlockStructured`.

    Notes
    -----
    With z' = k z the pair (k G, N'), N'(z') = N(z' / k), has the same output: numerator
    coefficients (and unknown initial values of z) are multiplied by k, gamma_m is divided
    by k^m. Each normalisation leaves one k: static gain 1 takes k = 1 / G(1), b_j = 1 takes
    k = 1 / b_j. gamma_1 = 1 takes k = gamma_1; fixing an even gamma_m instead would leave
    the sign of k open (and ask for its sign to be known), so that an odd one is to be fixed.
    Each choice supposes that its quantity is not zero in the true system.

    References
    ----------
    T. Wigren, "Recursive prediction error identification using the nonlinear Wiener
    model", Automatica 29 (1993) 1011-1025, section 2 (scale of the two blocks).

    Examples
    --------
    >>> import setid
    >>> setid.Wiener(setid.TransferFunction(1, 1, 1), 2, normalise="b1").parameters
    ('a1', 'gamma1', 'gamma2')
    """

    __slots__ = ()

    def __init__(
        self,
        linear: TransferFunction,
        basis: int | Sequence[Any],
        normalise: Normalise = None,
        initial: Initial = "free",
        form: Form = "auto",
    ) -> None:
        maps = {"y1": StaticMap("z", basis)}
        super().__init__(
            {("z", "u1"): linear}, maps, normalise=normalise, initial=initial, form=form
        )


class Lure(BlockStructured):
    """A static nonlinearity in the feedback: y = G (u - w), w = sum_m gamma_m y^m.

    Parameters
    ----------
    linear : TransferFunction
        Orders of G, with a delay (nk >= 1), so that the loop can be solved.
    basis : int or sequence of int
        Powers of y.
    normalise : optional
        ``"nolinear"``: the linear part of the loop belongs to G, which is ``{"gamma1": 0}`` where
        the linear term comes first in the basis;
        ``"gamma1"``: 1; ``"dcgain"``: static gain of G is 1; None: none.
    initial, form
        As for :class:`BlockStructured`.

    Raises
    ------
    ModelError
        If nk = 0.

    Notes
    -----
    The scale is no freedom here: G acts on u and w alike, so k G would change the way from u
    to y. The freedom is a shift of the loop. With G = B / D, y = G (u - N(y)) says

        D y + B N(y) = B u,   hence   (D + k B) y + B (N(y) - k y) = B u   for every k:

    a'_i = a_i + k b_i, gamma_1' = gamma_1 - k, and all else stays (a_i, b_i are zero where
    they do not exist). For nk >= 1 the leading coefficient stays 1. Fixing gamma_1 takes
    k = gamma_1 minus the number. Static gain 1 asks for D(1) + k B(1) = B(1), that is
    k = 1 - D(1) / B(1): unique where B(1) is not zero. Where the numerator reaches further back
    than the denominator (nk + nb - 1 > na), D + k B is no denominator of order na unless
    k = 0: the structure is unique without a normalisation, up to the case that the last
    numerator coefficients are zero.

    References
    ----------
    V. Cerone, D. Piga, D. Regruto, "Bounding the parameters of block-structured nonlinear
    feedback systems", Int. J. Robust and Nonlinear Control 23 (2013).
    C. A. Desoer, M. Vidyasagar, Feedback Systems, 1975, section III.6 (loop shifting).

    Examples
    --------
    >>> import setid
    >>> setid.Lure(setid.TransferFunction(1, 1, 1), 3, normalise="nolinear").parameters
    ('a1', 'b1', 'gamma2', 'gamma3')
    """

    __slots__ = ()

    def __init__(
        self,
        linear: TransferFunction,
        basis: int | Sequence[Any],
        normalise: Normalise = None,
        initial: Initial = "free",
        form: Form = "auto",
    ) -> None:
        if isinstance(linear, TransferFunction) and min(map(min, linear.nk)) < 1:
            raise ModelError(
                "linear: found nk = 0 in a feedback loop, expected a delay nk >= 1, so that "
                "the loop can be solved sample by sample"
            )
        maps = {"w": StaticMap("y1", basis)}
        if isinstance(normalise, str) and normalise == "nolinear":
            normalise = {_linear_weight(maps["w"]): 0.0}
        super().__init__(
            {("y1", "u1 - w"): linear}, maps, normalise=normalise, initial=initial, form=form
        )


def _linear_weight(item: StaticMap) -> str:
    """Name the coefficient of the linear term of the only map of a structure."""
    if (1,) not in item.basis:
        raise ModelError(
            "normalise: found 'nolinear' for a map without a linear term, expected None: without "
            "that term the loop has no shift"
        )
    return f"gamma{item.basis.index((1,)) + 1}"


class HammersteinWiener(BlockStructured):
    """Static nonlinearities on both sides: w = N(u), z = G w, y = M(z).

    Parameters
    ----------
    linear : TransferFunction
        Orders of G.
    basis, output_basis : int or sequence
        Of the map at the input and of that at the output.
    normalise : optional
        Two numbers must be fixed, such as ``["dcgain", "gamma[w]1"]``.
    initial, form
        As for :class:`BlockStructured`.

    Notes
    -----
    (k N, l G / k, M(. / l)) has the same output for all k, l != 0. A linear term of the
    input map and static gain 1, or any two of the choices for :class:`Hammerstein` and
    :class:`Wiener` that do not fix the same scale, settle both.

    Examples
    --------
    >>> import setid
    >>> shape = setid.TransferFunction(1, 1, 1)
    >>> setid.HammersteinWiener(shape, 2, 2, normalise=["gamma[w]1", "b1"]).parameters
    ('a1', 'gamma[w]2', 'gamma[y1]1', 'gamma[y1]2')
    """

    __slots__ = ()

    def __init__(
        self,
        linear: TransferFunction,
        basis: int | Sequence[Any],
        output_basis: int | Sequence[Any],
        normalise: Normalise = None,
        initial: Initial = "free",
        form: Form = "auto",
    ) -> None:
        maps = {"w": StaticMap("u1", basis), "y1": StaticMap("z", output_basis)}
        super().__init__(
            {("z", "w"): linear}, maps, normalise=normalise, initial=initial, form=form
        )
