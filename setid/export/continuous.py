"""From members of a discrete model set to continuous time: the indirect route.

Nothing here is proved. The map from discrete to physical coefficients is a logarithm of a
matrix (inverse zero-order hold) or of poles and zeros (matched): the image of a box is no
box, and a member without a real logarithm has no image at all.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import logm

from setid.data.checks import frozen, word
from setid.errors import ModelError, SetidError
from setid.export.python_control import coefficients
from setid.feasible_points.members import draws_of, members, nominal
from setid.feasible_set.feasible_set import FeasibleSet, check_result
from setid.models.checked_structures import coefficients_of
from setid.models.continuous import INDIRECT_WARNING
from sparsepop_py.algebra.read_only import ReadOnly

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["ContinuousEstimate", "to_continuous"]

Inverse = Literal["zoh", "matched"]
Reals = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ContinuousEstimate(ReadOnly):
    """Physical coefficients of sampled members of a discrete model set.

    Parameters
    ----------
    kind : str
        ``"sampled"``: ranges of members, not a cover of the set.
    method : {"zoh", "matched"}
    names : tuple of str
        ``a1``, ``a0``, ``b1``, ``b0``, ...: by power of s, falling, in the convention of
        :class:`ContinuousTransferFunction`.
    nominal : (p,) float
        Image of the nominal model.
    members : (M, p) float
        Images of attained members and of consistent mixtures.
    failed : int
        Members without an image: with poles at zero or on the negative real axis.
    warning : str

    Examples
    --------
    >>> import setid
    >>> model = setid.TransferFunction(na=1, nb=1, nk=1)
    >>> truth = setid.simulate_record(model, [-0.5, 1], [1, 3, -2, 1, 2], setid.Noise(0.01))
    >>> result = setid.identify(truth.data, model, setid.Noise(0.01))
    >>> setid.to_continuous(result).ranges.shape
    (2, 2)
    """

    kind: str
    method: str
    names: tuple[str, ...]
    nominal: Reals
    members: Reals
    failed: int
    warning: str

    def __repr__(self) -> str:
        names = ", ".join(self.names)
        return f"<ContinuousEstimate: {self.kind}, {names} of {len(self.members)} members>"

    @property
    def ranges(self) -> Reals:
        """Least and largest value over the members, shape (p, 2)."""
        values = np.vstack([self.nominal, self.members])
        return np.stack([values.min(axis=0), values.max(axis=0)], axis=1)

    def table(self) -> str:
        """Print one row a coefficient."""
        line = "{:<10}{:>15}{:>15}{:>15}"
        lines = [line.format("parameter", "nominal", "sampled low", "sampled high")]
        for name, value, (low, high) in zip(self.names, self.nominal, self.ranges, strict=True):
            lines.append(line.format(name, f"{value:.6g}", f"{low:.6g}", f"{high:.6g}"))
        return "\n".join([*lines, f"sampled, not proved: {self.warning}"])

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the sampled range of each coefficient; returns the axes."""
        from setid.plots.intervals import plot_ranges

        return plot_ranges(self, ax)


def to_continuous(
    result: FeasibleSet, method: Inverse = "zoh", samples: int = 100, seed: int = 0
) -> ContinuousEstimate:
    """Convert a discrete model set to continuous time, member by member.

    Parameters
    ----------
    result : FeasibleSet
        Of a discrete transfer function, one input and one output; of a block structure the linear
        block alone is converted.
    method : {"zoh", "matched"}
        Inverse zero-order hold; or p -> ln(p) / Ts for poles and zeros with the static gain
        kept, where zeros on the negative real axis (those that sampling makes) are left out. A
        static gain stays what it is by both.
    samples, seed : int
        Mixtures of attained members that are tried.

    Returns
    -------
    ContinuousEstimate
        Labelled *sampled*.

    Raises
    ------
    ModelError
        If the structure is not a discrete transfer function from one input to one output.
    SetidError
        If the feasible set is empty, or the nominal model has no image.

    References
    ----------
    K. J. Astrom, B. Wittenmark, Computer-Controlled Systems, 3rd ed. 1997, sections 2.3
    (inverse of sampling) and 8.2 (matched poles and zeros).

    Examples
    --------
    >>> import setid
    >>> model = setid.TransferFunction(na=1, nb=1, nk=1)
    >>> truth = setid.simulate_record(model, [-0.5, 1], [1, 3, -2, 1, 2], setid.Noise(0.01))
    >>> result = setid.identify(truth.data, model, setid.Noise(0.01))
    >>> found = setid.to_continuous(result)
    >>> found.kind, found.names, bool(abs(found.nominal[0] - 0.693) < 0.05)
    ('sampled', ('a0', 'b0'), True)
    """
    check_result(result)
    model = result.formulation.model
    if (model.inputs, model.outputs) != (1, 1):
        raise ModelError(
            f"result: found (inputs, outputs) = ({model.inputs}, {model.outputs}), expected a "
            "discrete transfer function of one input and one output"
        )
    if coefficients_of(model, 1, 1).continuous:
        raise ModelError(
            "result: found a continuous-time structure, expected a discrete transfer function; "
            "continuous-time structures have physical parameters already"
        )
    word(method, "method", _CONVERT, SetidError)
    draws_of(samples, seed)
    convert, Ts = _CONVERT[method], result.formulation.data.Ts
    centre = convert(*coefficients(model, nominal(result)), Ts)
    if centre is None:
        raise SetidError(
            "result: the nominal model has a pole at zero or on the negative real axis, and no "
            f"continuous-time model of its order by {method!r}; a shorter sampling interval helps"
        )
    images = [convert(*coefficients(model, theta), Ts) for theta in members(result, samples, seed)]
    kept = [image for image in images if image is not None]
    numerator, denominator = _padded(centre, kept)
    n, m = denominator.shape[1] - 1, numerator.shape[1] - 1
    names = tuple(f"a{i}" for i in range(n - 1, -1, -1)) + tuple(f"b{i}" for i in range(m, -1, -1))
    table = np.concatenate([denominator[:, 1:], numerator], axis=1)
    return ContinuousEstimate(
        "sampled",
        method,
        names,
        frozen(table[0].copy()),
        frozen(table[1:].copy()),
        len(images) - len(kept),
        INDIRECT_WARNING,
    )


Pair = tuple[Reals, Reals]


def _padded(centre: Pair, others: list[Pair]) -> Pair:
    """Numerators and denominators as tables, leading zeros in front of shorter ones."""
    found = []
    for side in (0, 1):
        size = max(pair[side].size for pair in [centre, *others])
        rows = [np.pad(p[side], (size - p[side].size, 0)) for p in [centre, *others]]
        found.append(np.array(rows))
    return found[0], found[1]


def _inverse_zoh(numerator: list[float], denominator: list[float], Ts: float) -> Pair | None:
    """Logarithm of [A B; 0 1] of the controllable form, if it is real."""
    a, b = np.array(denominator), np.array(numerator)
    n = a.size - 1
    if not n:
        return b, a  # a static gain, the same in continuous time
    state, push = np.zeros((n, n)), np.eye(n, 1)
    state[0], state[1:, :-1] = -a[1:], np.eye(n - 1)
    poles = np.linalg.eigvals(state)
    if np.any((np.abs(poles.imag) < 1e-12) & (poles.real <= 1e-12)):
        return None
    read, through = b[1:] - b[0] * a[1:], b[0]
    whole = np.block([[state, push], [np.zeros((1, n)), np.ones((1, 1))]])
    rate = np.asarray(logm(whole)) / Ts
    if not np.all(np.isfinite(rate)) or np.abs(rate.imag).max() > 1e-8 * np.abs(rate).max():
        return None
    flow, gain = rate.real[:n, :n], rate.real[:n, n]
    bottom = np.real(np.poly(flow))
    top = np.real(np.poly(flow - np.outer(gain, read))) - bottom + through * bottom
    return (top if through else top[1:]), bottom


def _inverse_matched(numerator: list[float], denominator: list[float], Ts: float) -> Pair | None:
    """ln(p) / Ts for poles and zeros, the static gain kept."""
    poles, zeros = np.roots(denominator).astype(complex), np.roots(numerator).astype(complex)
    if np.any(_without_logarithm(poles)) or abs(np.sum(denominator)) < 1e-12:
        return None
    zeros = zeros[~_without_logarithm(zeros)]
    bottom = np.atleast_1d(np.real(np.poly(np.log(poles) / Ts)))
    top = np.atleast_1d(np.real(np.poly(np.log(zeros) / Ts)))
    if top[-1] == 0.0:
        return None
    return top * (np.sum(numerator) / np.sum(denominator) * bottom[-1] / top[-1]), bottom


def _without_logarithm(roots: NDArray[np.complex128]) -> NDArray[np.bool_]:
    """Roots at zero or on the negative real axis."""
    return (np.abs(roots.imag) < 1e-9 * np.abs(roots)) & (roots.real < 0) | (np.abs(roots) < 1e-12)


_CONVERT = {"zoh": _inverse_zoh, "matched": _inverse_matched}
