"""Numbers in certificates: the variables, constraints and generators of a problem they refer to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.errors import ProblemError
from sparsepop_py.problem import generators
from sparsepop_py.problem.problem import Problem
from sparsepop_py.verified.box.left_inverse import LeftInverse
from sparsepop_py.verified.certificate.certificate import Certificate
from sparsepop_py.verified.certificate.exact_dual import ExactDual
from sparsepop_py.verified.certificate.lp_dual import LinearDual
from sparsepop_py.verified.certificate.rational_gram import ExactGram
from sparsepop_py.verified.certificate.sos_identity import Identity
from sparsepop_py.verified.certificate.steps import Known, Step, Sublevel, Tightening

__all__ = ["check_references"]


def check_references(certificate: Certificate, problem: Problem, place: str) -> None:
    """Refuse a certificate with numbers outside the ranges that a problem gives them.

    Whether an argument with such a number is needed makes no difference.

    Parameters
    ----------
    certificate : Certificate
        With all that it quotes.
    problem : Problem
    place : str
        For messages.

    Raises
    ------
    ProblemError
    """
    stack, seen = [certificate], set[int]()
    while stack:
        one = stack.pop()
        if id(one) in seen:
            continue
        seen.add(id(one))
        stack += [quoted for _, _, quoted in one.quotes]
        for node in one.root:
            if node.branch is not None:
                _below(node.branch[0], problem.dimension, f"{place}: branch")
            for step in node.box.steps:
                _check_step(step, problem, place)
            if node.argument is not None:
                _check_argument(node.argument, problem, False, f"{place}: argument")


def _check_step(step: Step, problem: Problem, place: str) -> None:
    n, here = problem.dimension, f"{place}: {type(step).__name__}"
    if isinstance(step, Known):
        _below([v for v, _, _ in step.bounds], n, here)
    elif isinstance(step, LeftInverse):
        _below(step.rows, len(problem.constraints), f"{here}.rows")
        _below(step.variables, n, f"{here}.variables")
    elif isinstance(step, Sublevel):
        _check_argument(step.identity, problem, True, here)
    elif isinstance(step, Tightening):
        _below(step.variable, n, f"{here}.variable")
        _check_argument(step.argument, problem, step.uses_cutoff, here, step.value.size)


def _check_argument(
    argument: Any, problem: Problem, cutoff: bool, place: str, owners: int = 1
) -> None:
    """Check the numbers of an argument; the row of a cutoff stands behind the constraints."""
    n, m = problem.dimension, len(problem.constraints) + cutoff
    equality = np.append(problem.equality, np.zeros(int(cutoff), bool))
    if isinstance(argument, ExactGram):
        _below(argument.basis, n + 1, f"{place}.basis")
        return
    if isinstance(argument, ExactDual):
        _same(argument.lower.size, n, place)
        _below(argument.row, m + 2 * n, f"{place}.row")
        free = np.append(equality, np.zeros(2 * n, bool))[argument.row]
        _check_words(argument.word, free, place)
        return
    _same(argument.scaling.centre.size, n, place)
    single = generators.count(m, n)
    if not generators.are_products(argument.products, single):
        raise _wrong(f"{place}.products", "another number", "numbers of earlier generators")
    stop = single + argument.products.shape[0]
    equal = np.zeros(stop, bool)
    equal[1 : m + 1] = equality
    if isinstance(argument, LinearDual):
        _below(argument.owner, owners, f"{place}.owner")
        _below(argument.generator, stop, f"{place}.generator")
        _check_words(argument.word, equal[argument.generator], place)
        return
    _check_groups(argument, problem, equal, place)


def _check_groups(
    identity: Identity, problem: Problem, equal: NDArray[np.bool_], place: str
) -> None:
    for group in identity.multipliers:
        _below(group.generator, equal.size, f"{place}.generator")
        if group.free and not equal[group.generator].all():
            raise _wrong(place, "a free multiplier of an inequality", "one of an equality")
        if not group.of_matrices(problem.matrices.side):
            raise _wrong(f"{place}.place", "another number", "rows of the matrix of a constraint")


def _check_words(words: NDArray[Any], free: NDArray[np.bool_], place: str) -> None:
    if np.any(words.any(axis=1) & ~free):
        raise _wrong(f"{place}.word", "a monomial at an inequality", "monomials at equalities")


def _same(found: int, dimension: int, place: str) -> None:
    if found != dimension:
        raise _wrong(place, f"{found} variables", f"{dimension}, as the problem has")


def _below(numbers: Any, stop: int, place: str) -> None:
    numbers = np.asarray(numbers)
    bad = numbers[(numbers < 0) | (numbers >= stop)]
    if bad.size:
        raise _wrong(place, str(bad[0]), f"a number from 0 to {stop - 1}")


def _wrong(place: str, found: str, expected: str) -> ProblemError:
    return ProblemError(f"{place}: found {found}, expected {expected}")
