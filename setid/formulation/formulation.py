"""From data, structure, noise and priors to one polynomial problem with named unknowns."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import sparsepop_py as sp
from setid.data.checks import parameters_of
from setid.data.noise import EnergyBound, Noise, NoiseConstraint, RateLimit
from setid.data.record import IOData
from setid.errors import DataError, ModelError, NoiseError, PriorError, SetidError, warn
from setid.formulation.assembly import Rows, build, check_rows_of_priors
from setid.formulation.completion import complete_point
from setid.formulation.layout import Layout
from setid.formulation.lifting import DRIVEN, LIFTED, Sum
from setid.formulation.printing import equation_text
from setid.formulation.regression import Regression, check_channels
from setid.formulation.rounding import rounded_coefficients
from setid.models.block import BlockStructured
from setid.models.continuous import ContinuousTransferFunction, at_rate
from setid.models.equations import Equation, Initial, Structure, channel_of
from setid.models.lti import TransferFunction
from setid.priors.base import Prior, listed
from setid.priors.checked_priors import description_of
from setid.priors.coefficients import Given
from setid.priors.normalisation import UnitGain
from sparsepop_py.verified.uncertain_rows.products import ProductRows

__all__ = [
    "Formulation",
    "Structs",
    "check_priors",
    "count_equations",
    "formulate",
    "lifted",
    "multiplied_out",
    "settled",
    "to_structs",
    "without_partial_outputs",
]

Structs = tuple[dict[str, Any], list[dict[str, Any]], NDArray[np.float64], NDArray[np.float64]]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Formulation:
    """A polynomial problem whose feasible set, projected on theta, is the feasible set.

    Parameters
    ----------
    problem : sparsepop_py.Problem
        Minimises the first parameter; bounds of all unknowns in ``lower`` and ``upper``.
        ``problem.with_objective`` asks for another parameter on the same set.
    layout : Layout
        Names and numbers of the unknowns.
    rows : Rows
        What each constraint comes from.
    regression : Regression or None
        Rows in theta alone that follow from the data and the noise bounds; None where the
        structure is not linear in its parameters.
    smoothed : Regression or None
        The same rows, and where they are differences over time also their sums through
        low-pass filters (:mod:`setid.formulation.smoothing`): what boxes of the parameters rest on.
    products : ProductRows or None
        The same in products of parameters, for block structures whose internal signals can
        be eliminated.
    sums : tuple of Sum
        What the unknowns of the group ``"lifted"`` are, in turn.
    data, model, noise, priors
        What was given; a continuous-time model at the sampling interval of the data, and
        the noise with its discretisation error.
    dropped : int
        Equations left out because a missing sample without a range occurs in them.
    assumptions : tuple of str
        What a result that rests on this formulation takes for granted.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> model = setid.TransferFunction(na=1, nb=1)
    >>> formulation = setid.formulate(data, model, setid.Noise(output=0.5))
    >>> formulation
    <Formulation: 2 parameters, 4 noise samples, 3 equations, degree 2>
    >>> print(formulation.equation(2))
    (-6.25 - eta[2]) + a1*(0 - eta[1]) - b0*(-3) == 0
    """

    problem: sp.Problem
    layout: Layout
    rows: Rows
    regression: Regression | None
    smoothed: Regression | None
    products: ProductRows | None
    sums: tuple[Sum, ...]
    data: IOData
    model: Structure
    noise: Noise
    priors: tuple[Prior, ...]
    dropped: int
    assumptions: tuple[str, ...]
    _equations: tuple[Equation, ...]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters, the first unknowns of the problem."""
        return self.model.parameters

    def equation(self, k: int, record: int = 1) -> str:
        """Print the model's equations at sample k, with numbers, as text.

        Parameters
        ----------
        k : int
            Sample, from 1.
        record : int
            From 1.

        Returns
        -------
        str
            One line an equation.

        Raises
        ------
        SetidError
            If there is no row for this sample.
        """
        chosen = self.rows.of_sample(k, record)
        names = dict.fromkeys(self.rows.equation[row] for row in chosen)
        by_name = {equation.defines: equation for equation in self._equations}
        equations = [by_name[name] for name in names]
        if not equations:
            samples = self.rows.sample[self.rows.record == record]
            raise SetidError(
                f"k: found {k} (record {record}), expected a sample with a row, "
                + (f"{samples.min()}..{samples.max()}" if samples.size else "of another record")
            )
        sample = int(self.data.starts[record - 1]) + k - 1
        return "\n".join(
            equation_text(e, sample, self.data, self.layout, self.noise) for e in equations
        )

    def structs(self, target: str | None = None) -> Structs:
        """State the problem in SparsePOP's data format.

        Parameters
        ----------
        target : str, optional
            The parameter to minimise, such as ``"a1"``, or with a sign to maximise, ``"-a1"``;
            the first one when left out.

        Returns
        -------
        objPoly, ineqPolySys, lbd, ubd
            As ``sparsePOP`` takes them; see :func:`setid.to_structs`.

        Raises
        ------
        SetidError
            If there is no such parameter.
        """
        name = str("" if target is None else target).strip() or self.parameters[0]
        sign = -1.0 if name.startswith("-") else 1.0
        name = name.removeprefix("-").strip()
        if name not in self.parameters:
            raise SetidError(
                f"target: found {target!r:.60}, expected one of {', '.join(self.parameters)}, "
                "with a minus sign to maximise"
            )
        return sp.to_structs(self.problem.with_objective(sign * self.layout.variable(name)))

    def to_gms(self, path: str | os.PathLike[str]) -> None:
        """Write the problem as a GAMS scalar file.

        Parameters
        ----------
        path : str or path
        """
        sp.write_gms(self.problem, path)

    def point(
        self,
        theta: ArrayLike | Mapping[str, float],
        output: ArrayLike | None = None,
        input: ArrayLike | None = None,
        equation: ArrayLike | None = None,
        signals: Mapping[str, ArrayLike] | None = None,
    ) -> NDArray[np.float64]:
        """Complete parameters and noise to the vector of all unknowns.

        Parameters
        ----------
        theta : array_like (p,) or mapping of names to numbers
        output, input, equation : array_like (N, channels), optional
            Noise; zero when left out. Samples without a variable are ignored.
        signals : mapping of str to array_like, optional
            Noise-free values of missing or internal signals, such as ``{"y": (N, ny)}`` or
            ``{"z[1,1]": (N,)}``. Internal signals that are left out are computed where they
            are defined by others, and otherwise chosen so that the rows fit best.

        Returns
        -------
        (n,) float
            ``problem.violation`` of it says whether it is feasible.
        """
        noise = {"eta": output, "xi": input, "e": equation}
        signals = {} if signals is None else signals
        if not isinstance(signals, Mapping):
            found = type(signals).__name__
            raise SetidError(f"signals: found {found}, expected a mapping of names to arrays")
        return complete_point(self, self.parameter_vector(theta), noise, signals)

    def witness(self, theta: ArrayLike | Mapping[str, float]) -> Any:
        """Call :func:`setid.least_noise`, of which this is the deprecated name.

        Parameters
        ----------
        theta : array_like (p,) or mapping of names to numbers
        """
        text = "Formulation.witness(theta) is now setid.least_noise(formulation, theta)"
        warnings.warn(text, DeprecationWarning, stacklevel=2)
        return import_module("setid").least_noise(self, theta)

    def parameter_vector(self, theta: ArrayLike | Mapping[str, float]) -> NDArray[np.float64]:
        """Check parameters and put them in order.

        Parameters
        ----------
        theta : array_like (p,) or mapping of names to numbers

        Returns
        -------
        (p,) float

        Raises
        ------
        SetidError
            If names or shape do not fit.
        """
        return parameters_of(theta, self.parameters)

    def __repr__(self) -> str:
        noise = sum(int(np.sum(self.layout.group(g) >= 0)) for g in ("eta", "xi", "e"))
        equations = len(
            {*zip(self.rows.equation, self.rows.record, self.rows.sample, strict=True)}
            - {("", 0, 0), (LIFTED, 0, 0)}
        )
        return (
            f"<Formulation: {len(self.parameters)} parameters, {noise} noise samples, "
            f"{equations} equations, degree {self.problem.degree}>"
        )


def formulate(
    data: IOData,
    model: Structure,
    noise: Noise,
    priors: Iterable[Prior | sp.Constraint] | Prior | sp.Constraint = (),
) -> Formulation:
    """State an identification problem as a polynomial problem.

    Parameters
    ----------
    data : IOData
    model : Structure
        Such as :class:`TransferFunction` or :class:`PolynomialNARX`.
    noise : Noise
    priors : iterable of priors and ``sp`` constraints
        Constraints are in the polynomials of :func:`parameters`.

    Returns
    -------
    Formulation

    Raises
    ------
    SetidError
        If the parts do not fit together, before any work starts: ``DataError``,
        ``NoiseError``, ``ModelError`` or ``PriorError``.

    Notes
    -----
    For each sample k from max(na, nk + nb - 1) + 1 on (all, with ``initial="zero"``)

        (y~_k - eta_k) + sum_i a_i (y~_{k-i} - eta_{k-i}) - sum_j b_j (u~_{k-j} - xi_{k-j}) = 0

    with abs(eta) and abs(xi) within their bounds. An equation error e_k with bound D turns
    the row into -D <= row <= D and needs no variable, unless a noise constraint asks for it.

    References
    ----------
    V. Cerone, D. Piga, D. Regruto, "Set-membership error-in-variables identification
    through convex relaxation techniques", IEEE Trans. Automatic Control 57 (2012) 517-522,
    eqs. (5)-(9).

    Examples
    --------
    >>> import setid, sparsepop_py as sp
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> model = setid.TransferFunction(na=1, nb=1)
    >>> formulation = setid.formulate(data, model, setid.Noise(equation=0.5))
    >>> result = sp.solve(formulation.problem)  # the least a1, about -0.52326
    >>> abs(result.lower_bound + 0.52326) < 1e-5
    True
    """
    check_channels(data, model)
    if not isinstance(noise, Noise):
        raise NoiseError(f"noise: found {type(noise).__name__}, expected Noise")
    model, noise = settled(data, model, noise)
    wanted = _as_priors(priors, model)
    silent = np.flatnonzero(np.all(np.nan_to_num(data.u) == 0.0, axis=0))
    if silent.size:
        warn(f"u: input {silent[0] + 1} is zero throughout; its coefficients cannot be bounded")
    built = build(data, model, noise, wanted)
    if not np.any(built.rows.sample):
        raise DataError(
            f"data: found {data.samples} samples in {data.records} records and no complete "
            f"equation, expected more than {max(e.lag for e in built.equations)} in a row without "
            "missing readings, in one record"
        )
    return Formulation(
        problem=built.problem,
        layout=built.layout,
        rows=built.rows,
        regression=built.regression,
        smoothed=built.smoothed,
        products=built.products,
        sums=built.sums,
        data=data,
        model=model,
        noise=noise,
        priors=wanted,
        dropped=built.dropped,
        assumptions=(
            *_assumptions(data, model, noise, wanted, built.dropped),
            *rounded_coefficients(data, built.equations, _computes_numbers(model)),
            *(f"{record}; the rows are about what was rounded" for record in built.roundings),
        ),
        _equations=built.equations,
    )


def multiplied_out(formulation: Formulation) -> Formulation:
    """State a formulation without sums of products as unknowns of their own.

    Parameters
    ----------
    formulation : Formulation

    Returns
    -------
    Formulation
        In the first unknowns of the given one, which has the others behind them; the given one
        where there are none.
    """
    model = formulation.model
    if not formulation.layout.group(LIFTED).size:
        return formulation
    plain: Structure = model
    if isinstance(model, TransferFunction):
        plain = replace(model, form="direct" if model.form == DRIVEN else "multiplied")
    elif isinstance(model, BlockStructured):
        plain = model.changed(form="auto")
    return _of_structure(formulation, plain)


def without_partial_outputs(formulation: Formulation, from_rest: bool = False) -> Formulation:
    """Multiply denominators out where partial outputs have no bounds from the data.

    Every consistent parameter vector is kept. There may be more: those of which two denominators
    have a common zero, or of systems that do not begin at rest, where an offset is added.

    Parameters
    ----------
    formulation : Formulation
    from_rest : bool
        Whether systems that begin at rest have to stay so; then they may keep partial outputs.

    Returns
    -------
    Formulation
        With sums of products as unknowns; the given one where nothing is multiplied out.
    """
    model, n, problem = formulation.model, len(formulation.parameters), formulation.problem
    if not isinstance(model, TransferFunction) or model.form not in ("auto", "partial"):
        return formulation
    if not np.any(np.isinf(problem.lower[n:]) | np.isinf(problem.upper[n:])):
        return formulation
    if all(channel_of(equation.defines) is not None for equation in formulation._equations):
        return formulation  # there are none
    if from_rest and model.offset and model.initial == "zero":
        return formulation
    # an offset is on the outputs themselves; its first samples tell nothing then
    initial: Initial = "free" if model.offset else model.initial
    return _of_structure(formulation, replace(model, form=LIFTED, initial=initial))


def lifted(formulation: Formulation) -> Formulation:
    """State a block structure with sums of products as unknowns, where noise multiplies such.

    Parameters
    ----------
    formulation : Formulation

    Returns
    -------
    Formulation
        With further unknowns behind those of the given one; the given one where nothing is gained.
    """
    model = formulation.model
    if not isinstance(model, BlockStructured) or model.form != "auto":
        return formulation
    found = _of_structure(formulation, model.changed(form=LIFTED))
    words, own = found.problem.rows.words, found.layout.group(LIFTED) + 1
    sums = np.isin(words, own)
    noisy = np.any((words > len(found.parameters)) & ~sums, axis=1)
    return found if np.any(noisy & np.any(sums, axis=1)) else formulation


def _of_structure(formulation: Formulation, model: Structure) -> Formulation:
    """State the same question for another structure."""
    return formulate(formulation.data, model, formulation.noise, formulation.priors)


def to_structs(
    data: IOData,
    model: Structure,
    noise: Noise,
    priors: Iterable[Prior | sp.Constraint] | Prior | sp.Constraint = (),
    target: str | None = None,
) -> Structs:
    """State an identification problem in the data format of SparsePOP.

    Parameters
    ----------
    data, model, noise, priors
        As of :func:`formulate`.
    target : str, optional
        The parameter to minimise, such as ``"a1"``, or with a sign to maximise, ``"-a1"``; the
        first one when left out.

    Returns
    -------
    objPoly : dict
        Objective.
    ineqPolySys : list of dict
        Constraints; with noise on outputs and inputs, one bilinear equation a sample, such as
        12 terms for order 2.
    lbd, ubd : (n,) float
        Bounds of all unknowns, in the order of ``formulate(...).layout.names``; 1e10 stands for
        none.

    Raises
    ------
    SetidError
        If the parts do not fit together, or there is no such parameter.

    Examples
    --------
    >>> import setid, sparsepop_py as sp
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> model = setid.TransferFunction(na=1, nb=1)
    >>> given = data, model, setid.Noise(equation=0.5)
    >>> least = sp.sparsePOP(*setid.to_structs(*given, target="b0"), {"printLevel": 0})
    >>> most = sp.sparsePOP(*setid.to_structs(*given, target="-b0"), {"printLevel": 0})
    >>> abs(least.SDPobjValue - 1.91667) < 1e-4, abs(-most.SDPobjValue - 2.1093) < 1e-4
    (True, True)
    """
    return formulate(data, model, noise, priors).structs(target)


def settled(data: IOData, model: Structure, noise: Noise) -> tuple[Structure, Noise]:
    """Settle a structure at the data's sampling interval, and the noise with its ``delta``."""
    model = at_rate(model, data.Ts)
    if not isinstance(model, ContinuousTransferFunction):
        return model, noise
    if model.delta == "estimate":
        raise ModelError(
            "delta: found 'estimate', expected a number; setid.identify estimates it, and "
            "setid.estimate_delta(data, model, noise) does so alone"
        )
    return model, noise.covering(max(model.delta, noise.model_error))


def check_priors(given: Any, model: Structure) -> None:
    """Check that priors fit a structure, before there are samples.

    Raises
    ------
    PriorError
        If one is no prior, or speaks of other parameters.
    """
    check_rows_of_priors(model, _as_priors(given, model))


def _as_priors(given: Any, model: Structure) -> tuple[Prior, ...]:
    found: list[Prior] = []
    for place, item in enumerate(listed(given)):
        if isinstance(item, sp.Constraint):
            if item.polynomial.dimension != len(model.parameters):
                raise PriorError(
                    f"priors[{place}]: found a constraint in {item.polynomial.dimension} "
                    f"variables, expected {len(model.parameters)}, from setid.parameters(model)"
                )
            if item.kind.is_matrix:
                raise PriorError(
                    f"priors[{place}]: found a {item.kind.name} constraint, expected a "
                    "polynomial inequality or equation"
                )
            item = Given(item)
        if isinstance(item, Given):
            names = item.constraint.polynomial.names
            if names not in (None, model.parameters):  # its text would name other parameters
                raise PriorError(
                    f"priors[{place}]: found a constraint in {', '.join(names or ())}, expected "
                    f"{', '.join(model.parameters)}, from setid.parameters(model)"
                )
        if isinstance(item, type) or not isinstance(item, Prior):  # a class has the methods too
            raise PriorError(
                f"priors[{place}]: found {type(item).__name__}, expected a prior such as Stable() "
                "or a constraint in setid.parameters(model)"
            )
        found.append(item)
    return _normalised(model, found)


def _normalised(model: Structure, priors: Sequence[Prior]) -> tuple[Prior, ...]:
    """With the static gains that the structure itself asks for."""
    if not isinstance(model, BlockStructured) or not model.unit_gain:
        return tuple(priors)
    own = UnitGain(model.unit_gain)
    return tuple(priors) if own in priors else (*priors, own)


def _assumptions(
    data: IOData, model: Structure, noise: Noise, priors: Sequence[Prior], dropped: int
) -> tuple[str, ...]:
    texts = [*data.assumptions, *noise.assumptions]
    texts.append(f"the system is a {model!r}")
    if isinstance(model, ContinuousTransferFunction):
        texts.append(model.between_samples(noise.model_error))
    texts.append("each noise sample lies within its bound")
    texts += [_described(constraint) for constraint in noise.constraints]
    if model.initial == "zero":
        texts.append("all signals are zero before the record")
    for field in ("u_range", "y_range"):
        if getattr(data, field) is not None and np.isnan(getattr(data, field[0])).any():
            texts.append(f"missing samples of {field[0]} lie in {getattr(data, field).tolist()}")
    texts += [f"prior: {description_of(prior)}" for prior in priors]
    if dropped:
        texts.append(f"{dropped} equations with missing samples are left out")
    return tuple(dict.fromkeys(texts))


def _described(constraint: NoiseConstraint) -> str:
    """Say what a constraint on the noise over the record is."""
    if isinstance(constraint, EnergyBound | RateLimit):
        return constraint.describe()
    name = getattr(constraint, "__name__", type(constraint).__name__)
    return f"the noise satisfies the constraints that {name} states"


def _computes_numbers(model: Structure) -> bool:
    """Check that numbers in equations come from others: sampling times, products of fixed ones."""
    if isinstance(model, BlockStructured):
        return len(model.fixed) > 1
    return isinstance(model, ContinuousTransferFunction) and model.method != "indirect"


def count_equations(formulation: Formulation) -> int:
    """Count the equations of a problem.

    Parameters
    ----------
    formulation : Formulation
    """
    return int(np.count_nonzero(formulation.problem.equality))
