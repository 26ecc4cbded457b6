"""The evidence for the intervals of an identification, and the verdict on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import wraps
from inspect import signature
from typing import NamedTuple, ParamSpec, Protocol

import numpy as np

import sparsepop_py as sp
from setid.errors import SetidError
from setid.formulation.formulation import Formulation
from setid.proofs.fields import well_formed
from setid.proofs.intervals import IntervalStatus, ParameterInterval
from setid.proofs.parameter_box import ProvedBox
from setid.proofs.uniqueness.normalisation import Nonzero
from setid.proofs.uniqueness.unbounded import Unbounded

__all__ = ["DAMAGE", "Claimed", "EndProof", "Evidence", "Verification", "as_verdict"]

P = ParamSpec("P")

DAMAGE = (  # what fields end in that do not fit each other
    sp.SparsePOPError,
    ArithmeticError,
    AssertionError,
    AttributeError,
    LookupError,
    TypeError,
    ValueError,
    RecursionError,
)


@dataclass(frozen=True, slots=True)
class Verification:
    """Verdict of a check; true where every claim holds.

    Parameters
    ----------
    ok : bool
    reason : str
        The first claim that does not hold; empty where all do.

    Examples
    --------
    >>> import setid
    >>> bool(setid.Verification(True)), bool(setid.Verification(False, "no box"))
    (True, False)
    """

    ok: bool
    reason: str = ""

    def __bool__(self) -> bool:
        return self.ok


def as_verdict(verify: Callable[P, Verification]) -> Callable[P, Verification]:
    """Make a check return a verdict, also where fields do not fit each other.

    Stored results come from anywhere: arrays of other shapes and missing parts are forgeries, for
    which False is an answer and an exception is none. Numbers overflow there without a warning.
    A call with arguments that the check does not take says nothing of a result: a TypeError.

    Types of the fields of a proof are checked first, see :func:`setid.proofs.fields.well_formed`.

    Examples
    --------
    >>> as_verdict(lambda pair: Verification(pair[2] == 1))((0, 1))
    Verification(ok=False, reason='the fields do not fit each other: tuple index out of range')
    """
    taken = signature(verify)

    @wraps(verify)
    def checked(*args: P.args, **kwargs: P.kwargs) -> Verification:
        given = [*taken.bind(*args, **kwargs).arguments.values()]
        try:
            with np.errstate(all="ignore"):
                if not all(map(well_formed, given[:1])):
                    return Verification(False, "a field is of another type than its class states")
                return verify(*args, **kwargs)
        except FloatingPointError:  # of a process whose arithmetic proves nothing
            raise
        except SetidError as error:
            return Verification(False, str(error))
        except DAMAGE as error:
            return Verification(False, f"the fields do not fit each other: {error!s:.200}")

    return checked


class EndProof(NamedTuple):
    """Proof of one end of an interval, and a point that attains it.

    Parameters
    ----------
    certificate : sparsepop_py.Certificate or None
    attained : sparsepop_py.ProvedPoint or None
    """

    certificate: sp.Certificate | None
    attained: sp.ProvedPoint | None


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """Claims about a record with all that they rest on; nothing in it is trusted.

    Parameters
    ----------
    formulation : Formulation
        Data, structure, noise and priors; its problem is stated again.
    intervals : mapping of str to ParameterInterval
        The claims.
    problem : sparsepop_py.Problem
        The problem that certificates and points are about.
    box : ParameterBox, DirectionBox, LiftedBox, CellBox or None
        The box of the parameters from the data alone, with its proof.
    bounds : tuple of sparsepop_py.LinearBound
        For linear problems: exact bounds of theta_1, -theta_1, theta_2, ...
    ends : tuple of EndProof
        Otherwise: certificates and attained points of theta_1, -theta_1, theta_2, ..., in the
        units of :func:`setid.formulation.units.in_units`.
    unbounded : Unbounded or None
        Proof that parameters are unbounded.
    reference : Evidence or None
        For a structure without a normalisation: the evidence with the one that was used.
    nonzero : ParameterBox, CellBox or None
        Proof that the normalisation of the reference excludes no consistent system.
    fewer_priors : Evidence or None
        Evidence of the same data, structure and noise with some of the priors: what it bounds
        is bounded with all of them.
    driven : Evidence or None
        Evidence of rows with an offset of the equation (:mod:`setid.proofs.driven`): the problem
        has the parameters in what it bounds.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> result.evidence.empty, len(result.evidence.bounds)
    (False, 4)
    """

    formulation: Formulation
    intervals: Mapping[str, ParameterInterval]
    problem: sp.Problem
    box: ProvedBox | None = None
    bounds: tuple[sp.LinearBound, ...] = ()
    ends: tuple[EndProof, ...] = ()
    unbounded: Unbounded | None = None
    reference: Evidence | None = None
    nonzero: Nonzero | None = None
    fewer_priors: Evidence | None = None
    driven: Evidence | None = None

    @property
    def evidence(self) -> Evidence:
        """Itself, so that :func:`setid.verify` takes it as it takes a result."""
        return self

    @property
    def empty(self) -> bool:
        """True if it is claimed that no parameter is consistent."""
        return any(item.status is IntervalStatus.EMPTY for item in self.intervals.values())


class Claimed(Protocol):
    """A result that shows the evidence for what it claims."""

    @property
    def evidence(self) -> Evidence:
        """The claims and all that they rest on."""
