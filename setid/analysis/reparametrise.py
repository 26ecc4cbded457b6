"""Intervals of physical parameters, from those of coefficients and the relations between them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import sparsepop_py as sp
from setid.data.checks import FrozenMapping, frozen
from setid.data.record import IOData
from setid.errors import SetidError
from setid.feasible_points.inner_ends import loosened
from setid.formulation.formulation import Formulation
from setid.formulation.units import InUnits, in_units
from setid.html import listing, section
from setid.html import table as html_table
from setid.options import Options, checked_options
from setid.priors.physical import Physical
from setid.proofs.evidence import EndProof, Verification
from setid.proofs.existence import admitted
from setid.proofs.fields import check_fields
from setid.proofs.intervals import IntervalStatus, ParameterInterval, overstated
from setid.proofs.physical import objectives_of, problem_within, verify_physical, with_relations
from setid.result.damaged_texts import (
    list_of,
    member_of,
    object_of,
    refused,
    texts_of,
)
from setid.result.identification import Identification, least_settled
from setid.result.json_parts import check_attained, read, write
from sparsepop_py.io.json_files.certificates import CERTIFICATES
from sparsepop_py.io.json_files.codecs import optional, parsed
from sparsepop_py.io.json_files.values import PROVED_POINT
from sparsepop_py.verified.arithmetic.display import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["Reparametrisation", "reparametrise"]

_KIND = "reparametrisation"
_SECONDS = 60.0  # where options say nothing
_HEAD = {"format": "setid", "version": 1, "is": _KIND}
_KEYS = ("identification", "physical", "intervals", "certificates", "attained", "notes")
_INTERVAL = ("name", "outer", "inner", "status")
_POINT = optional(PROVED_POINT)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Reparametrisation:
    """Uncertainty intervals of physical parameters, and all that they rest on.

    Parameters
    ----------
    identification : Identification
        Of the coefficients of the structure.
    physical : Physical
        The physical parameters and their relations to the coefficients.
    intervals : mapping of str to ParameterInterval
        One a physical parameter: proved and attained ends.
    formulation : Formulation or None
        The problem in all unknowns; None where the set is empty already.
    ends : tuple of EndProof
        Certificates and attained points of phi_1, -phi_1, phi_2, ...
    notes : tuple of str
    tol : float
        What certified intervals keep to: the largest distance of outer and attained ends, as a
        fraction of the attained width.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> found = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> gain = setid.Physical({"K": (0, 10)}, ["b0 = K*(1 + a1)"])
    >>> result = setid.reparametrise(found, gain)
    >>> result.intervals["K"].status, bool(result.verify(data))
    (<IntervalStatus.CERTIFIED: 'certified'>, True)
    """

    identification: Identification
    physical: Physical
    intervals: Mapping[str, ParameterInterval]
    formulation: Formulation | None
    ends: tuple[EndProof, ...] = ()
    notes: tuple[str, ...] = ()
    tol: float = Options().tol

    @property
    def empty(self) -> bool:
        """True if it is proved that no parameters are consistent."""
        return all(item.status is IntervalStatus.EMPTY for item in self.intervals.values())

    @property
    def status(self) -> IntervalStatus:
        """The least settled status of all physical parameters."""
        return least_settled(self.intervals)

    def summary(self) -> str:
        """Write the table, what the status means, and what is taken for granted."""
        lines = [self.table(), f"{self.status}: {self.status.message}"]
        lines += [f"note: {text}" for text in self.notes]
        return "\n".join([*lines, "taken for granted:", *(f"- {text}" for text in self._granted())])

    def table(self) -> str:
        """Write the intervals as text, one row a parameter; outer ends rounded outwards."""
        line = "{:<12}{:>15}{:>15}{:>15}{:>15}  {}"
        lines = [line.format("parameter", "outer", "", "inner", "", "status")]
        return "\n".join([*lines, *(line.format(*row) for row in self._rows())])

    def _rows(self) -> list[tuple[object, ...]]:
        rows: list[tuple[object, ...]] = []
        for name, item in self.intervals.items():
            outer = rounded(item.outer[0], False, 8), rounded(item.outer[1], True, 8)
            inner = ("-", "-")
            if item.inner is not None:
                inner = rounded(item.inner[0], True, 8), rounded(item.inner[1], False, 8)
            outer = ("empty", "") if self.empty else outer
            rows.append((name, *outer, *inner, item.status))
        return rows

    def _granted(self) -> list[str]:
        return [*self.identification.assumptions, f"prior: {self.physical!r}"]

    def _repr_html_(self) -> str:
        head = ["parameter", "outer (proved)", "", "inner (attained)", "", "status"]
        return section(
            "physical parameters",
            html_table(head, self._rows()),
            listing("notes", self.notes),
            listing("taken for granted", self._granted()),
        )

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the interval of each physical parameter; returns the axes."""
        from setid.plots.intervals import plot_intervals

        return plot_intervals(self, ax)

    def verify(self, data: IOData | None = None) -> Verification:
        """Check every claim again from the data, without any solver.

        Parameters
        ----------
        data : IOData, optional
            The record; the one that was stored when left out.

        Returns
        -------
        Verification
            True where the identification, all outer and all attained ends hold, and those of
            certified intervals agree.
        """
        claims = self.identification.evidence
        verdict = verify_physical(claims, self.physical, self.intervals, self.ends, data)
        reason = overstated(self.intervals, self.tol) if verdict else ""
        return Verification(False, reason) if reason else verdict

    def to_json(self) -> str:
        """Write the result with its evidence as JSON text.

        Returns
        -------
        str
            What :meth:`from_json` reads.

        Raises
        ------
        SetidError
            If structure, noise or priors hold functions, which have no text.

        Examples
        --------
        >>> import setid
        >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
        >>> found = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
        >>> result = setid.reparametrise(found, setid.Physical({"K": (0, 10)}, ["b0 = K"]))
        >>> setid.Reparametrisation.from_json(result.to_json()).intervals["K"].status
        <IntervalStatus.CERTIFIED: 'certified'>
        """
        items = [
            {
                "name": item.name,
                "outer": write(item.outer),
                "inner": write(item.inner),
                "status": item.status.name,
            }
            for item in self.intervals.values()
        ]
        content = {
            "identification": json.loads(self.identification.to_json()),
            "physical": write(self.physical, "physical"),
            "intervals": items,
            "certificates": CERTIFICATES.write([end.certificate for end in self.ends]),
            "attained": [_POINT.write(end.attained) for end in self.ends],
            "notes": list(self.notes),
            "tol": write(self.tol),
        }
        return json.dumps({**_HEAD, _KIND: content}, allow_nan=False, separators=(",", ":"))

    @classmethod
    def from_json(cls, text: str) -> Reparametrisation:
        """Read a result and verify every claim of it; no solver is run.

        Parameters
        ----------
        text : str
            As :meth:`to_json` makes it.

        Returns
        -------
        Reparametrisation

        Raises
        ------
        SetidError
            If the text is no result, or a claim in it does not follow from the record in it.
        """
        with refused("from_json", "a stored result"):
            found = object_of(parsed(text), "from_json", [*_HEAD, _KIND])
            if {key: found[key] for key in _HEAD} != _HEAD:
                raise SetidError(f"from_json: found {found['is']!r:.60}, expected {_KIND!r}")
            result = _read(found[_KIND])
        with refused("from_json: verification", "claims that can be checked"):
            verdict = result.verify()
        if not verdict:
            raise SetidError(f"from_json: found a claim that does not hold: {verdict.reason}")
        check_attained(result.intervals)
        return result

    def __repr__(self) -> str:
        return "\n".join(repr(item) for item in self.intervals.values())


def reparametrise(
    result: Identification, physical: Physical, options: Options | None = None
) -> Reparametrisation:
    """Prove an uncertainty interval for each physical parameter.

    Parameters
    ----------
    result : Identification
        Of a structure whose coefficients the relations speak of, without these relations.
    physical : Physical
    options : Options, optional
        Left out: a time limit of 60 s, since what leaves a physical parameter unbounded is not
        found out, and relaxations of higher and higher order follow.

    Returns
    -------
    Reparametrisation
        Outer ends hold for all physical parameters that are consistent with the record, the
        priors and the relations; inner ends are attained by such parameters with their noise.

    Raises
    ------
    SetidError
        If the parts do not fit together.

    References
    ----------
    F. Bugarin, D. Henrion, J. B. Lasserre, "Minimizing the sum of many rational functions",
    Math. Prog. Comp. 8 (2016) 83-111 (relations with quotients).

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> found = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> delay = setid.Physical({"T": (0.01, 100)}, ["a1 = -T/(1 + T)"])
    >>> setid.reparametrise(found, delay).intervals["T"]
    T in [0.527494, 1.09757], attained [0.527495, 1.09756], certified
    """
    settings = checked_options(options, Options(time_limit=_SECONDS))
    if not isinstance(result, Identification):
        raise SetidError(f"result: found {type(result).__name__}, expected an Identification")
    if not isinstance(physical, Physical):
        raise SetidError(f"physical: found {type(physical).__name__}, expected setid.Physical")
    if result.empty:
        return Reparametrisation(result, physical, _empty(physical), None)
    deadline = settings.limits()  # it counts how the problem is stated, too
    formulation = with_relations(result.formulation, physical, result.intervals)
    problem = problem_within(formulation, result.intervals)
    scaled = in_units(problem, formulation)
    found = sp.solve_each(
        scaled.problem,
        [scaled.asked(objective)[0] for objective in objectives_of(formulation, physical)],
        settings.within(deadline).for_engine(),
        start=_start(formulation, result, scaled),
    )
    notes = tuple(dict.fromkeys(note for one in found for note in one.notes))
    if any(one.status is sp.Status.INFEASIBLE for one in found):
        items = _empty(physical)
    else:
        items = _intervals(formulation, physical, scaled, found, float(settings.tol))
    ends = tuple(EndProof(one.certificate, one.attained) for one in found)
    tol = float(settings.tol)
    return Reparametrisation(result, physical, items, formulation, ends, notes, tol)


def _read(found: Any) -> Reparametrisation:
    """Build a result from what its text holds; nothing in it is verified yet."""
    object_of(found, _KIND, _KEYS)
    known = Identification.from_json(json.dumps(found["identification"]))
    physical = read(found["physical"], "physical")
    if not isinstance(physical, Physical):
        raise SetidError(f"physical: found {type(physical).__name__}, expected Physical")
    items = {}
    for k, item in enumerate(list_of(found["intervals"], "intervals")):
        place = f"intervals[{k}]"
        object_of(item, place, _INTERVAL)
        outer, inner = (read(item[key], f"{place}.{key}") for key in ("outer", "inner"))
        status = member_of(IntervalStatus, item["status"], f"{place}.status")
        made = ParameterInterval(item["name"], outer, inner, status)
        check_fields(made, place)
        items[made.name] = made
    points = [_POINT.read(point, "attained") for point in list_of(found["attained"], "attained")]
    proofs = CERTIFICATES.read(found["certificates"], "certificates")
    ends = tuple(EndProof(*pair) for pair in zip(proofs, points, strict=True))
    formulation = None
    if not known.empty:
        formulation = with_relations(known.formulation, physical, known.intervals)
    notes = texts_of(found["notes"], "notes")
    tol = float(Options(tol=read(found.get("tol", Options().tol))).tol)  # older texts do not say
    return Reparametrisation(known, physical, FrozenMapping(items), formulation, ends, notes, tol)


def _empty(physical: Physical) -> FrozenMapping[str, ParameterInterval]:
    status = IntervalStatus.EMPTY
    return FrozenMapping(
        {name: ParameterInterval(name, (inf, -inf), None, status) for name in physical.names}
    )


def _start(
    formulation: Formulation, result: Identification, scaled: InUnits
) -> NDArray[np.float64] | None:
    """Extend a consistent vector of the coefficients by physical parameters."""
    witnesses = [w for item in result.intervals.values() for w in item.witnesses if w is not None]
    if not witnesses:
        return None
    known = dict(zip(result.formulation.layout.names, witnesses[0].tolist(), strict=True))
    theta = {name: known[name] for name in formulation.parameters}
    known |= formulation.priors[-1].complete(formulation.model, theta)
    x = np.array([known.get(name, 0.0) for name in formulation.layout.names])
    return np.clip(x / scaled.units, scaled.problem.lower, scaled.problem.upper)


def _intervals(
    formulation: Formulation,
    physical: Physical,
    scaled: InUnits,
    found: list[sp.Result],
    tol: float,
) -> FrozenMapping[str, ParameterInterval]:
    items = {}
    for place, name in enumerate(physical.names):
        variable = formulation.layout.index(name)
        unit, problem = float(scaled.units[variable]), scaled.problem
        low, high = found[2 * place], found[2 * place + 1]
        outer = (
            max(float(problem.lower[variable]), low.lower_bound) * unit,
            min(float(problem.upper[variable]), -high.lower_bound) * unit,
        )
        points = [_admitted(formulation, scaled, one.attained) for one in (low, high)]
        ends = [loosened(point.value, point) * unit for point in points if point is not None]
        inner = (ends[0], -ends[1]) if len(ends) == 2 else None
        if inner is not None and problem.lower[variable] == problem.upper[variable]:
            inner = outer
        first, last = (None if q is None else frozen(q.x * scaled.units) for q in points)
        item = ParameterInterval(name, outer, inner, IntervalStatus.PARTIAL, (first, last))
        if item.gap <= tol * (1.0 + 1e-9) or inner == outer:
            item = replace(item, status=IntervalStatus.CERTIFIED)
        items[name] = item
    return FrozenMapping(items)


def _admitted(
    formulation: Formulation, scaled: InUnits, point: sp.ProvedPoint | None
) -> sp.ProvedPoint | None:
    """Return a point, None where priors mean less than their rows and do not admit it."""
    units = scaled.units[: len(formulation.parameters)]
    if point is None:
        return None
    theta, reach = point.x[: units.size] * units, point.radius * units
    return point if admitted(formulation, theta, reach) else None
