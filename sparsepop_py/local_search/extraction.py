"""Extraction of candidate minimisers from moments.

Nothing here is proved: the points are starts for local search and for the proof that a
point is attained.

References
----------
D. Henrion, J. B. Lasserre, Detecting global optimality and extracting solutions in
GloptiPoly, in: Positive Polynomials in Control, Springer (2005) 293-310.
R. M. Corless, P. M. Gianni, B. M. Trager, A reordered Schur factorization method for
zero-dimensional polynomial systems with multiple roots, ISSAC (1997) 133-140.
R. E. Curto, L. A. Fialkow, Trans. Amer. Math. Soc. 352 (2000) 2825-2855 (flat extension).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from sparsepop_py.algebra import monomials
from sparsepop_py.algebra.monomials import Words
from sparsepop_py.budget import importing
from sparsepop_py.relaxation.moment import Relaxation

__all__ = ["candidates", "combine", "extract", "means"]

_RANK = 1e-4  # of the largest eigenvalue: smaller ones count as zero
_AGREE = 1e-3  # largest difference of candidates that agree, relative to max(1, abs(value))
_VANISH = 1e-3  # share of the root of a second moment: a smaller first moment, or point, is 0
_MOST = 16  # partial points that are kept
_SEED = 20050  # any fixed number: extraction is deterministic
Points = list[NDArray[np.float64]]


def candidates(relaxation: Relaxation, y: NDArray[np.float64]) -> Points:
    """Extract candidate minimisers from the moments of a relaxation.

    A moment block with the constant determines the variables that are among its monomials. The
    others are those of :func:`means`. Where the blocks give 0 to variables whose second moments
    are not 0, minimisers come with both signs: a last point has the roots of these moments.

    Parameters
    ----------
    relaxation : Relaxation
    y : (M,) float
        Its moments.

    Returns
    -------
    list of (n,) float
        In the relaxation's variables.
    """
    moments = np.append(1.0, y)
    found: list[tuple[int, NDArray[np.int64], Points]] = []
    for group in relaxation.groups:
        if group.free:
            continue
        alike: dict[bytes, list[_Block]] = {}  # blocks that differ by names of variables only
        for block in np.flatnonzero(group.generator == 0).tolist():
            basis, members = _readable(group.basis[block])
            if members.size:
                local = _renamed(basis, members)
                key = b"%d " % local.shape[1] + local.tobytes()
                own = _Block(int(group.clique[block]), members, local, basis)
                alike.setdefault(key, []).append(own)
        for blocks in alike.values():
            stack = _matrices(relaxation, np.stack([own.basis for own in blocks]), moments)
            extracted = extract(stack, blocks[0].words)
            found += [(b.clique, b.members, p) for b, p in zip(blocks, extracted, strict=True)]
    found.sort(key=lambda entry: entry[0])
    dimension, last = relaxation.problem.dimension, len(relaxation.cliques.members)
    either = _without_first_moment(relaxation)
    if either.size:
        found.append((last, either, [_roots(relaxation, moments, either)]))
    points = combine([p for *_, p in found], [m.tolist() for _, m, _ in found], dimension)
    vanishing = _vanishing(relaxation, moments, points)
    if vanishing.size:
        signed = points[0].copy()
        signed[vanishing] = _roots(relaxation, moments, vanishing)
        points.append(signed)
    return points


def means(relaxation: Relaxation, y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the first moments, or roots of second ones where minimisers come with both signs.

    A relaxation that uses sign symmetries has no first moment of a variable whose sign is open.
    There the root of the moment of its square is returned. Signs relative to each other are those
    of the moments of products.

    Parameters
    ----------
    relaxation : Relaxation
    y : (M,) float
        Its moments.

    Returns
    -------
    (n,) float
        In the relaxation's variables; 0 for a variable of which no moment tells.
    """
    moments = np.append(1.0, y)
    number = relaxation.variable_numbers
    point = np.where(number > 0, moments[np.maximum(number, 0)], 0.0)
    either = _without_first_moment(relaxation)
    point[either] = _roots(relaxation, moments, either)
    return point


def _letters(relaxation: Relaxation) -> Words:
    return np.arange(1, relaxation.problem.dimension + 1, dtype=np.int32)[:, None]


def _without_first_moment(relaxation: Relaxation) -> NDArray[np.int64]:
    return np.flatnonzero(relaxation.variable_numbers < 0)


def _vanishing(
    relaxation: Relaxation, moments: NDArray[np.float64], points: Points
) -> NDArray[np.int64]:
    """List the variables that are 0 at all points, but whose second moments are not."""
    number = relaxation.moment_numbers(np.repeat(_letters(relaxation), 2, axis=1))
    root = np.sqrt(np.maximum(np.where(number > 0, moments[np.maximum(number, 0)], 0.0), 0.0))
    largest = np.abs(points).max(axis=0)
    return np.flatnonzero((root > _VANISH) & (largest <= _VANISH * root))


def _roots(
    relaxation: Relaxation, moments: NDArray[np.float64], either: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Compute roots of second moments of variables, with signs that agree.

    Where a square is no moment, that of a product is divided by its known factor. Few
    relaxations come to the graph: networkx, which takes a tenth of a second, is loaded for it.
    """
    if not either.size:
        return np.zeros(0)
    letters, words = _letters(relaxation), monomials.widen(relaxation.moments, 2)
    number = relaxation.moment_numbers(np.repeat(letters[either], 2, axis=1))
    known = either[number > 0]
    point = np.zeros(letters.size)
    point[known] = np.sqrt(np.maximum(moments[number[number > 0]], 0.0))
    mixed = np.flatnonzero(monomials.degrees(words) == 2)
    first, second = (words[mixed, k].astype(np.int64) - 1 for k in (-2, -1))
    inside = np.isin(first, either) & np.isin(second, either) & (first != second)
    value = moments[mixed[inside] + 1]
    with importing():
        import networkx as nx

    graph = nx.Graph()
    graph.add_nodes_from(either.tolist())
    ends = zip(first[inside].tolist(), second[inside].tolist(), value.tolist(), strict=True)
    graph.add_edges_from((i, j, {"value": v, "size": abs(v)}) for i, j, v in ends)
    forest = nx.maximum_spanning_tree(graph, weight="size")
    for part in nx.connected_components(forest):
        for near, far in nx.bfs_edges(forest, max(sorted(part), key=point.__getitem__)):
            product = forest.edges[near, far]["value"]
            if point[far]:
                point[far] = np.copysign(point[far], product * point[near])
            elif point[near]:
                point[far] = product / point[near]
    return point[either]


class _Block(NamedTuple):
    """Words of a moment block: in letters 1..k of its members, and as they are."""

    clique: int
    members: NDArray[np.int64]
    words: Words
    basis: Words


def _matrices(
    relaxation: Relaxation, bases: Words, moments: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Moment matrices (K, s, s) of bases (K, s, D)."""
    count, size, _ = bases.shape
    i, j = np.triu_indices(size)
    products = monomials.multiply(bases[:, i], bases[:, j])
    number = relaxation.moment_numbers(products.reshape(-1, products.shape[2]))
    matrices = np.zeros((count, size, size))
    matrices[:, i, j] = matrices[:, j, i] = moments[number].reshape(count, -1)
    return matrices


def _readable(basis: Words) -> tuple[Words, NDArray[np.int64]]:
    """Select the words of a moment block in the variables that it determines."""
    degree = monomials.degrees(basis)
    letters = np.unique(basis[degree == 1][:, -1])
    if not np.any(degree == 0):
        letters = letters[:0]
    inside = np.all(np.isin(basis, np.append(letters, 0)), axis=1)
    return basis[inside], letters.astype(np.int64) - 1


def _renamed(basis: Words, members: NDArray[np.int64]) -> Words:
    """Words in letters 1..k instead of those of k members, ascending."""
    local = np.searchsorted(members + 1, basis) + 1
    return np.where(basis > 0, local, 0).astype(np.int32)


def extract(matrices: NDArray[np.float64], words: Words) -> list[Points]:
    """Extract the atoms of the measures behind moment matrices of one pattern.

    The atoms are found if a matrix is flat: its rank is that of the rows whose products
    with every variable are rows again (in a full basis of degree d, those of degree d-1).
    Otherwise, and if a reduced basis lacks too many monomials, the first moments are given.

    Parameters
    ----------
    matrices : (B, s, s) float
    words : (s, D) int32
        Monomials of their rows, in letters 1..k: the constant first, and each letter.

    Returns
    -------
    list of lists of (k,) float
        For each matrix the atoms by falling weight, or one point, the first moments; NaN
        where the matrix is not finite or the moment of 1 is not positive.

    References
    ----------
    Henrion, Lasserre (2005), section 2; Curto, Fialkow (2000).

    Examples
    --------
    The measure with half its mass at -1 and half at 2:

    >>> words = monomials.full_basis(1, 2)
    >>> rows = monomials.evaluate(words, np.array([[-1.0], [2.0]]))
    >>> (points,) = extract(rows.T @ rows[None] / 2, words)
    >>> sorted(round(float(point[0]), 6) for point in points)
    [-1.0, 2.0]
    """
    letters = np.arange(int(words.max(initial=0)))
    sound = np.all(np.isfinite(matrices), axis=(1, 2)) & (matrices[:, 0, 0] > 0)
    points = [[np.full(letters.size, np.nan)] for _ in matrices]
    good = matrices[sound]
    good = (good + good.transpose(0, 2, 1)) / (2 * good[:, :1, :1])
    shifted = _shifts(words, letters)
    values, vectors = np.linalg.eigh(good)
    rank = np.sum(values > _RANK * values[:, -1:], axis=1)
    single = _single_atoms(vectors[:, :, -1], shifted)
    for k, place in enumerate(np.flatnonzero(sound).tolist()):
        if rank[k] == 1 and single is not None:
            points[place] = [single[k]]
            continue
        factor = vectors[k][:, -rank[k] :] * np.sqrt(values[k][-rank[k] :])
        found = _atoms(factor, shifted)  # matrix = factor factor'
        if found is not None:
            points[place] = _by_weight(found, good[k][0], words)
        else:
            points[place] = [good[k][0, shifted[:, 0]]]  # rows of 1 * x_v
    return points


def combine(
    points_per_clique: Sequence[Points], members_list: Sequence[Sequence[int]], dimension: int
) -> Points:
    """Join the candidates of cliques to points of all variables.

    Cliques are added in the given order. A candidate continues each partial point that it
    agrees with on the variables already set; where none agrees, the nearest one is taken
    and the shared variables become averages. This is greedy, and at most 16 partial
    points are kept.

    Parameters
    ----------
    points_per_clique : sequence of lists of (k,) float
        As :func:`extract` returns them for one matrix; NaN where unknown.
    members_list : sequence of sequences of int
        The variables of each clique, from 0.
    dimension : int
        Number of variables n.

    Returns
    -------
    list of (n,) float
        At least one point; variables that no clique knows are 0.

    Examples
    --------
    >>> first = [np.array([1.0, 2.0]), np.array([5.0, 6.0])]
    >>> second = [np.array([6.0, 7.0]), np.array([2.0, 3.0])]
    >>> [point.tolist() for point in combine([first, second], [(0, 1), (1, 2)], 3)]
    [[1.0, 2.0, 3.0], [5.0, 6.0, 7.0]]
    """
    rng = np.random.default_rng(_SEED)
    partial = np.full((1, dimension), np.nan)
    count = np.zeros(dimension)
    for points, members in zip(points_per_clique, members_list, strict=True):
        if not points:
            continue
        columns = np.asarray(members, np.int64)
        candidates = np.array(points, float)
        known = partial[:, columns]
        rows, picks = _pairs(_agreement(known, candidates), rng)
        if rows.size > partial.shape[0]:  # each partial point is continued at least once
            partial, known = partial[rows], known[rows]
        new = candidates[picks]
        mean = known + (new - known) / (count[columns] + 1)
        partial[:, columns] = np.where(np.isnan(known), new, np.where(np.isnan(new), known, mean))
        count[columns] += 1
    return list(np.nan_to_num(partial, nan=0.0))


# ---- cliques of one pattern -------------------------------------------------------------


def _single_atoms(
    factors: NDArray[np.float64], shifted: NDArray[np.int64]
) -> NDArray[np.float64] | None:
    """Compute the only atom of matrices f f', None if not flat.

    Rows f are (B, s), atoms (B, k); the atom of f = 0 is NaN.
    """
    inner = np.flatnonzero(np.all(shifted >= 0, axis=0))
    if not inner.size:
        return None
    pivot = inner[np.argmax(np.abs(factors[:, inner]), axis=1)]
    rows = np.arange(pivot.size)
    pivots = factors[rows, pivot]
    pivots = np.where(pivots == 0.0, np.nan, pivots)  # a factor 0 has no atom
    return factors[rows[:, None], shifted[:, pivot].T] / pivots[:, None]


def _shifts(basis: Words, members: NDArray[Any]) -> NDArray[np.int64]:
    """Find the row of x_v times word j, shape (k, s), -1 for none."""
    width = basis.shape[1] + 1
    letters = (members + 1).astype(np.int32)[:, None, None]
    products = monomials.multiply(basis[None], letters).reshape(-1, width)
    largest = int(max(basis.max(initial=1), letters.max(initial=1)))
    keys = monomials.pack(monomials.widen(basis, width), largest)
    wanted = monomials.pack(products, largest)
    order = np.argsort(keys)
    slot = np.minimum(np.searchsorted(keys[order], wanted), keys.size - 1)
    row = order[slot]
    return np.where(keys[row] == wanted, row, -1).reshape(members.size, -1)


def _atoms(factor: NDArray[Any], shifted: NDArray[Any]) -> NDArray[Any] | None:
    """Compute the atoms (rank, k) of factor factor', None if not flat."""
    rank = factor.shape[1]
    inner = np.flatnonzero(np.all(shifted >= 0, axis=0))
    if inner.size < rank:
        return None
    # Rows of `factor` that span the others serve as the pivots of the column
    # echelon form; pivoted QR chooses them, which amplifies noise least.
    _, triangle, pivot = linalg.qr(factor[inner].T, mode="economic", pivoting=True)
    if abs(triangle[rank - 1, rank - 1]) <= np.sqrt(_RANK) * abs(triangle[0, 0]):
        return None
    pivots = inner[pivot[:rank]]
    echelon = linalg.solve(factor[pivots].T, factor.T).T  # words = echelon @ words[pivots]
    return _joint_eigenvalues(echelon[shifted[:, pivots]])


def _joint_eigenvalues(multiplications: NDArray[Any]) -> NDArray[np.float64]:
    """Compute the eigenvalues (rank, k) of commuting matrices (k, rank, rank).

    A random combination separates the atoms, so that its Schur vectors are those of every
    matrix; the Schur form is orthogonal and hence stable (Corless, Gianni, Trager 1997).
    """
    share: NDArray[Any] = np.random.default_rng(_SEED).random((multiplications.shape[0],))
    mixture = np.tensordot(share / share.sum(), multiplications, axes=1)
    _, schur = linalg.schur(mixture, output="real")
    return np.einsum("rj,vrs,sj->jv", schur, multiplications, schur)


def _by_weight(points: NDArray[Any], moments: NDArray[Any], words: Words) -> Points:
    """Sort points by falling weight in the measure, from the moments of the words."""
    weights = np.linalg.lstsq(monomials.evaluate(words, points).T, moments, rcond=None)[0]
    return [points[j] for j in np.argsort(-weights, kind="stable")]


# ---- many cliques -----------------------------------------------------------------------


def _agreement(known: NDArray[Any], candidates: NDArray[Any]) -> NDArray[np.float64]:
    """Compute the largest relative difference of points (P, k) and candidates (C, k), (P, C)."""
    gap = np.abs(known[:, None, :] - candidates[None, :, :])
    scale = np.maximum(1.0, np.nan_to_num(np.abs(candidates), nan=1.0))
    return np.nan_to_num(gap / scale, nan=0.0).max(axis=-1, initial=0.0)


def _pairs(
    distance: NDArray[Any], rng: np.random.Generator
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Match partial points with candidates: (row, pick), rows ascending.

    Every row gets its nearest candidate if none agrees, one of the agreeing ones at
    random, and more of them while there is room. Without chance, the candidates listed
    first would be the only ones left.
    """
    agree = distance <= _AGREE
    lonely = ~agree.any(axis=1)
    agree[lonely, distance[lonely].argmin(axis=1)] = True
    row, pick = np.nonzero(agree)
    if row.size <= _MOST:
        return row, pick
    shuffled = rng.permutation(row.size)
    _, first = np.unique(row[shuffled], return_index=True)
    others = np.setdiff1d(np.arange(row.size), first)
    chosen = np.sort(shuffled[np.concatenate([first, others[: _MOST - first.size]])])
    return row[chosen], pick[chosen]
