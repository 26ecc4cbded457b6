"""Blocks that come from outside, checked before a relaxation is made of them.

Wrong blocks cannot make a bound false, since the proof multiplies generators out again. They end in
exceptions of array libraries, or relax another problem, though.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sparsepop_py.algebra.polynomial_system import PolynomialSystem
from sparsepop_py.errors import ProblemError
from sparsepop_py.problem.problem import Problem
from sparsepop_py.relaxation.blocks import BlockGroup, Blocks

__all__ = ["checked_blocks"]


def checked_blocks(
    given: Any, place: str, problem: Problem, cliques: int, system: PolynomialSystem
) -> Blocks:
    """Check the blocks of a registered shape.

    Parameters
    ----------
    given : object
        What it returned.
    place : str
        Its name for messages.
    problem : Problem
    cliques : int
        How many there are.
    system : PolynomialSystem
        All generators.

    Returns
    -------
    list of BlockGroup
        With words of 32-bit letters in order.

    Raises
    ------
    ProblemError
        If it is no list of blocks of this problem.
    """
    if not isinstance(given, Sequence) or isinstance(given, (str, bytes)):
        raise ProblemError(f"{place}: found {type(given).__name__}, expected a list of BlockGroup")
    return [
        _checked(block, f"{place}, block {number}", problem, cliques, system)
        for number, block in enumerate(given)
    ]


def _checked(
    block: Any, place: str, problem: Problem, cliques: int, system: PolynomialSystem
) -> BlockGroup:
    if not isinstance(block, BlockGroup):
        raise ProblemError(f"{place}: found {type(block).__name__}, expected a BlockGroup")
    basis = _whole(block.basis, f"{place}, basis", 3, 0, problem.dimension)
    if not all(basis.shape):
        raise ProblemError(f"{place}: found a basis of shape {basis.shape}, expected no empty one")
    count = basis.shape[0]
    generator = _whole(block.generator, f"{place}, generator", 1, 0, system.size - 1)
    clique = _whole(block.clique, f"{place}, clique", 1, -1, cliques - 1)
    if generator.size != count or clique.size != count:
        raise ProblemError(
            f"{place}: found {generator.size} generators and {clique.size} cliques, expected "
            f"{count}, one for each basis"
        )
    if not isinstance(block.free, (bool, np.bool_)):
        raise ProblemError(f"{place}: found free={block.free!r:.60}, expected True or False")
    if block.free:
        _check_free(generator, place, problem)
    words = np.sort(basis, axis=2).astype(np.int32)
    if any(len({*map(tuple, each)}) < len(each) for each in words.tolist()):
        raise ProblemError(f"{place}: found a monomial twice in a basis, expected it once")
    rows = None if block.place is None else _places(block, f"{place}, place", words, problem)
    return replace(block, generator=generator, clique=clique, basis=words, place=rows)


def _whole(given: Any, place: str, axes: int, low: int, high: int) -> Any:
    """Check an array of integers in a range."""
    if not isinstance(given, np.ndarray) or given.ndim != axes or given.dtype.kind not in "iu":
        kind = type(given).__name__
        if isinstance(given, np.ndarray):
            kind = f"{given.dtype} in {given.ndim} axes"
        raise ProblemError(f"{place}: found {kind}, expected an array of integers in {axes} axes")
    wrong = given[(given < low) | (given > high)]
    if wrong.size:
        raise ProblemError(f"{place}: found {wrong[0]}, expected {low} to {high}")
    return given.astype(np.int64)


def _check_free(generator: Any, place: str, problem: Problem) -> None:
    """Refuse multipliers of any sign for what is no equation."""
    equal = np.concatenate([[False], problem.equality])
    known = generator < equal.size
    wrong = generator[~np.where(known, equal[np.where(known, generator, 0)], False)]
    if wrong.size:
        raise ProblemError(
            f"{place}: found free multipliers of generator {wrong[0]}, expected those of equations"
        )


def _places(block: BlockGroup, place: str, words: Any, problem: Problem) -> Any:
    """Check which rows of matrices go with monomials."""
    places = _whole(block.place, place, 2, 0, 2**31)
    side = np.zeros(block.generator.max() + 1, int)
    for number, constraint in enumerate(problem.constraints[: side.size - 1], 1):
        side[number] = constraint.side if constraint.entries else 0
    if places.shape != words.shape[:2] or np.any(places >= side[block.generator][:, None]):
        raise ProblemError(
            f"{place}: found rows up to {places.max(initial=0)} in shape {places.shape}, expected "
            f"rows of matrix constraints in shape {words.shape[:2]}"
        )
    return places
