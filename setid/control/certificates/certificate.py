"""Certificates that a controller stabilises every plant that is consistent with a record."""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import inf
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from setid.control.certificates.arcs import Ceiling
from setid.control.certificates.cells import Claim, Outcome, prove_over_cells
from setid.control.certificates.characteristic import Characteristic
from setid.control.certificates.conditions import Condition, exact_conditions
from setid.control.certificates.refutation import unstable_plant
from setid.control.certificates.small_gain import SmallGain
from setid.control.engine import (
    Identification,
    IOData,
    ModelError,
    Noise,
    NoiseError,
    Options,
    SetidError,
    TransferFunction,
    Verification,
    as_verdict,
    natural,
    number,
    word,
)
from setid.control.parameters.parameter_set import (
    ParameterSet,
    consistent_set,
    identified,
    tightened,
)
from setid.control.parameters.sums import within_doubles
from setid.control.references import gain_of_one, with_unit_gain
from setid.control.transfer import Transfer, as_transfer
from setid.data.checks import seconds_of
from setid.data.digits import all_digits
from sparsepop_py.budget import Deadline, LimitReached
from sparsepop_py.verified.arithmetic.display import rounded

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "NOTHING",
    "Question",
    "StabilityCertificate",
    "plant_model",
    "stability_certificate",
]

Method = Literal["small_gain", "characteristic"]
_SNAP = 1e-6  # largest residual of a pole that is taken to be at z = 1, relative
_PROOF = 0.75  # of the time for the proof; the rest looks for a plant that refutes it
_EARLY = 0.2  # of the time that is left, to look for it before the engine is asked
_ROOM = 1.0 + 1e-9  # on bounds, so that a proof that is drawn again elsewhere stays below them
_WITHOUT_MARGIN = "unbounded without a margin"
NOTHING = "no plant of this structure is consistent with the record, proved"
_REFUTED = "a consistent plant makes an unstable loop, both proved"
_STRONG = "the data give no finite set of plants: the noise is strong"
_NOT_STABLE = f"{_WITHOUT_MARGIN}: that all consistent plants are stable is not proved"
_LATE = "no finite set of plants was found in time: the noise is strong, or time is short"
_UNBOUNDED = tuple(
    f"{prefix}{why}" for prefix in ("", f"{_WITHOUT_MARGIN}; ") for why in (_STRONG, _LATE)
)
_OPEN = (NOTHING, *_UNBOUNDED, _NOT_STABLE)
_UNPROVED = re.compile(
    r"no proof near [\d.e+-]*(, [\d.e+-]+)* rad a sample; a failing proof says nothing of the loop"
)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class StabilityCertificate:
    """Verdict on whether a controller stabilises every consistent plant.

    Parameters
    ----------
    verdict : {"certified", "refuted", "open"}
        Certified: every consistent plant makes an internally stable loop, proved. Refuted: a
        consistent plant, ``plant``, makes an unstable loop, both proved. Open: neither.
    reason : str
    method : {"small_gain", "characteristic"}
    conditions : tuple of Condition
    bound : float
        Proved bound of abs(Delta) over all frequencies and all consistent plants; infinite where
        none is proved, NaN where the method has none.
    arcs : tuple of (from, to, bound)
        Bounds of abs(Delta) on arcs of the unit circle, rad a sample. Those of several cells of the
        parameters overlap: at each frequency the largest bound there is what is claimed.
    controller, reference : Transfer
        What the verdict is about, poles at z = 1 being exact.
    model : TransferFunction
        Of the plant.
    parameters : ParameterSet or None
        A polytope that contains every consistent plant, as it was found: files do not keep it, and
        ``verify`` makes it again without looking at this one.
    plant : Transfer or None
        A consistent plant with an unstable loop.
    margin : float or None
    integrators : int
    assumptions : tuple of str
    help : tuple of str
        What would help where the verdict is open.
    cells : int
    seconds : float
    data : IOData
        The experiment.
    noise : Noise
    identification : Identification or None
        What the engine proved of the parameters, where the proof rests on it.
    """

    verdict: Literal["certified", "refuted", "open"]
    reason: str
    method: Method
    conditions: tuple[Condition, ...]
    bound: float
    arcs: tuple[tuple[float, float, float], ...]
    controller: Transfer
    reference: Transfer
    model: TransferFunction
    parameters: ParameterSet | None
    plant: Transfer | None
    margin: float | None
    integrators: int
    assumptions: tuple[str, ...]
    help: tuple[str, ...]
    cells: int
    seconds: float
    data: IOData
    noise: Noise
    identification: Identification | None = None

    def __bool__(self) -> bool:
        return self.verdict == "certified"

    def summary(self) -> str:
        """Describe verdict, conditions, assumptions and advice as text."""
        lines = [f"{self.verdict}: {self.reason}"]
        if self.plant is not None:
            lines.append(f"  consistent plant with an unstable loop: {self.plant!r}")
        lines += [f"  condition {c}" for c in self.conditions]
        lines += [f"  assumed: {text}" for text in self.assumptions]
        lines += [f"  would help: {text}" for text in self.help]
        return "\n".join(lines)

    @as_verdict
    def verify(self) -> Verification:
        """Draw every conclusion again from the record, without a clock.

        Linear programs propose multipliers as before; what follows from them is proved again.
        """
        from setid.control.certificates.stored import verify

        return verify(self)

    def to_json(self) -> str:
        """Write the certificate with its record as JSON text."""
        from setid.control.certificates.stored import to_json

        return to_json(self)

    @staticmethod
    def from_json(text: str) -> StabilityCertificate:
        """Read a certificate and verify it; text that does not verify is refused.

        Parameters
        ----------
        text : str
            As :meth:`to_json` makes it.
        """
        from setid.control.certificates.stored import from_json

        return from_json(text)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the bound of abs(Delta) over frequency (needs matplotlib)."""
        from setid.control.plots import plot_certificate

        return plot_certificate(self, ax)

    def __repr__(self) -> str:
        return f"<StabilityCertificate: {self.verdict} by {self.method}: {self.reason}>"


def stability_certificate(
    data: IOData,
    K: Any,
    M: Any,
    plant_order: int | TransferFunction,
    noise: Noise | float,
    margin: float | None = None,
    method: Method = "small_gain",
    *,
    delay: int = 0,
    integrators: int = 0,
    time_limit: float = 60.0,
    snap: float = _SNAP,
) -> StabilityCertificate:
    """Prove that a controller stabilises every plant that is consistent with a record.

    Parameters
    ----------
    data : IOData
        The experiment on the plant alone: input r, measured output.
    K, M : Transfer, (numerator, denominator) or python-control model
        Controller and reference model.
    plant_order : int or TransferFunction
        An upper bound of the plant's order, or its whole structure.
    noise : Noise or float
        Bound of the output's noise.
    margin : float, optional
        Assumption: the plant's poles have abs(z) <= 1 - margin (an integrator that is
        declared excepted). Listed in the result.
    method : {"small_gain", "characteristic"}
        Bound abs(M - K P (1 - M)) < 1, or prove the characteristic polynomial stable.
    delay : int
        Samples of delay of the plant, with an integer ``plant_order``.
    integrators : int
        Plant poles at exactly z = 1, 0 or 1.
    time_limit : float
        Seconds. Linear programs of arcs that have begun are ended, so that large records may
        take a little longer. Where it passes before the set of all plants is made, a wider one
        is taken that needs fewer linear programs.
    snap : float
        Largest distance of a pole of the controller, and of the static gain of M, from 1 that is
        taken for none; what was moved is listed among the assumptions.

    Returns
    -------
    StabilityCertificate

    Raises
    ------
    SetidError
        If the parts do not fit together.

    References
    ----------
    V. Cerone, D. Regruto, M. Abuabiah, "Direct data-driven control design through
    set-membership errors-in-variables identification techniques", American Control
    Conference 2017, 388-393.

    Examples
    --------
    >>> import numpy as np, setid
    >>> from setid import control
    >>> P, M = control.Transfer([0, 1], [1, -0.5]), control.Transfer([0, 0.4], [1, -0.6])
    >>> r = np.random.default_rng(0).uniform(-1, 1, 60)
    >>> data = setid.IOData(r, P.simulate(r))
    >>> K = control.ideal_controller(P, M)
    >>> found = control.stability_certificate(data, K, M, 1, setid.Noise(output=0.01), delay=1)
    >>> found.verdict, bool(found.bound < 0.1)
    ('certified', True)
    """
    begin = time.monotonic()
    if not isinstance(data, IOData):
        raise SetidError(f"data: found {type(data).__name__}, expected IOData")
    word(method, "method", ("small_gain", "characteristic"), SetidError)
    if margin is not None:
        margin = number(margin, "margin", SetidError)
        if not 0.0 < margin < 1.0:
            raise SetidError(f"margin: found {margin!r}, expected a number between 0 and 1")
    noise = _output_noise(noise)
    model = plant_model(plant_order, delay)
    controller, reference, moved = _known(K, M, data.Ts, snap)
    poles = natural(integrators, "integrators", SetidError)
    if poles > min(model.na[0][0], 1):
        raise SetidError(f"integrators: found {poles}, expected 0 or 1, at most the plant's order")
    task = Question(data, noise, model, controller, reference, margin, poles, method)
    with np.errstate(all="ignore"):  # numbers that overflow prove nothing
        return task.run(begin, seconds_of(time_limit), moved)


def plant_model(order: int | TransferFunction, delay: int = 0) -> TransferFunction:
    """Build the structure of a plant of at most an order, with ``initial="free"``."""
    if isinstance(order, TransferFunction):
        return order
    if not isinstance(order, (int, np.integer)):
        raise ModelError(
            f"plant_order: found {type(order).__name__}, expected an integer >= 0 or a "
            "TransferFunction"
        )
    n = natural(order, "plant_order", ModelError)
    lag = natural(delay, "delay", ModelError)
    return TransferFunction(n, max(n + 1 - lag, 1), lag)


def _output_noise(noise: Noise | float) -> Noise:
    found = noise if isinstance(noise, Noise) else Noise(output=noise)
    if np.any(np.asarray(found.input) > 0):
        raise NoiseError(
            "noise.input: found a bound > 0, expected 0: the input of the experiment is known"
        )
    return found


def _known(K: Any, M: Any, Ts: float, snap: float) -> tuple[Transfer, Transfer, tuple[str, ...]]:
    """Controller and reference model with exact poles at 1, and what was moved for that."""
    if not 0.0 <= number(snap, "snap", ModelError) < 1.0:
        raise ModelError(f"snap: found {snap!r}, expected a fraction in [0, 1)")
    texts = []
    controller, rest = as_transfer(K, Ts, "K").reduced().snapped(snap)
    if rest:
        texts.append(
            f"the controller's pole near z = 1 is at exactly 1 (its denominator was {rest:.3g} "
            "there): implement certificate.controller"
        )
    reference = as_transfer(M, Ts, "M").reduced()
    reference, gain = with_unit_gain(reference, snap)
    if gain:
        texts.append(gain_of_one(gain))
    return controller, reference, tuple(texts)


def _largest(outcome: Outcome) -> str:
    """Write the largest bound of all arcs, rounded upwards."""
    bound = max((b for *_, b in outcome.arcs), default=0.0)
    return f"max abs(Delta) <= {rounded(bound * _ROOM, True, 4)}"


@dataclass(frozen=True, slots=True, eq=False)
class Question:
    """The parts of one question, and the stages of its answer.

    Parameters
    ----------
    data, noise, model, controller, reference, margin, integrators, method
        As :class:`StabilityCertificate` has them.
    """

    data: IOData
    noise: Noise
    model: TransferFunction
    controller: Transfer
    reference: Transfer
    margin: float | None
    integrators: int
    method: Method

    def run(self, begin: float, limit: float, moved: tuple[str, ...]) -> StabilityCertificate:
        """Prove, refute or leave open within a time limit in seconds."""
        conditions, factor = self.exact_conditions()
        assumptions = (*self._assumptions(), *moved)
        if any(c.holds is False for c in conditions):
            failed = next(c for c in conditions if c.holds is False)
            blank = Outcome(False, (), (), 0)
            return self._answer(
                None, blank, f"{failed.name} fails: {failed.text}", conditions, assumptions, None
            )
        claim = self.claim(factor)
        until, result = begin + _PROOF * limit, None
        found, outcome = self._prove(claim, until)
        now, plant = time.monotonic(), None
        late = found is None and now > until
        if not outcome.proved and now < until:
            plant = self._refuting(found, now + _EARLY * (until - now))
        asks = not outcome.proved and plant is None and time.monotonic() < until
        if asks and found is not None and not found.empty:
            with suppress(LimitReached):  # then all of it is as if it had not been begun
                found, outcome, result = self._prove_within(found, claim, until)
        if not outcome.proved and plant is None:
            plant = self._refuting(found, begin + limit)
        reason = self._reason(found, outcome, plant, late)
        answer = self._answer(
            found, outcome, reason, self._judged(conditions, outcome), assumptions, plant
        )
        return replace(answer, identification=result, seconds=time.monotonic() - begin)

    def claim(self, factor: Transfer | None, ceiling: Ceiling | None = None) -> Claim:
        """Find what holds cell by cell, F being the factor of small gain."""
        if self.method == "characteristic":
            return Characteristic(self.model, self.controller)
        assert factor is not None
        return SmallGain(self.model, factor, self.reference, self.integrators, self.margin, ceiling)

    def _prove(self, claim: Claim, until: float) -> tuple[ParameterSet | None, Outcome]:
        """Prove a claim over the set from sums of rows alone: whole, then cell by cell."""
        found, outcome = self.known(until), Outcome(False, (), (), 0)
        if found is None or found.empty:
            return found, outcome
        now = time.monotonic()
        for part, most in ((1.0, 1), (0.2, inf)):  # of the time left, before the engine is asked
            outcome = prove_over_cells(found, claim, now + part * (until - now), most)
            if outcome.proved or time.monotonic() > until:
                break
        return found, outcome

    def _prove_within(
        self, found: ParameterSet, claim: Claim, until: float
    ) -> tuple[ParameterSet, Outcome, Identification | None]:
        """Prove a claim over what the engine's intervals leave of a set, cell by cell."""
        share = Options(time_limit=max(0.5 * (until - time.monotonic()), 0.1), progress=False)
        result = identified(
            self.data, self.model, self.noise, found, self.integrators, share, self.margin
        )
        if result.empty:
            return self.narrowed(found, result), Outcome(False, (), (), 0), result
        found = self.narrowed(found, result, until)
        return found, prove_over_cells(found, claim, until), result

    def _refuting(self, found: ParameterSet | None, until: float) -> Transfer | None:
        """Look for a consistent plant that the controller does not stabilise."""
        if found is not None and found.empty:
            return None
        try:
            with Deadline(until - time.monotonic()).kept(0.0):  # linear programs look at it
                return within_doubles(
                    lambda: unstable_plant(
                        self.data,
                        self.model,
                        self.noise,
                        self.controller,
                        found,
                        self.integrators,
                        self.margin,
                        until,
                    )
                )
        except LimitReached:
            return None

    def known(self, until: float = inf, brief: bool = False) -> ParameterSet | None:
        """Enclose all consistent plants in a polytope, by sums of rows."""
        parts = self.data, self.model, self.noise, self.integrators, self.margin
        return consistent_set(*parts, until=until, brief=brief)

    def narrowed(
        self, found: ParameterSet, result: Identification, until: float = inf
    ) -> ParameterSet:
        """Take the part of a set that an identification leaves."""
        if result.empty:
            return found.part(found.polytope.within(found.polytope.upper, found.polytope.lower))
        return tightened(found, result, until)

    # ---- conditions ---------------------------------------------------------------------

    def exact_conditions(self) -> tuple[tuple[Condition, ...], Transfer | None]:
        """Decide conditions in rationals, and find F = K (1 - M), which the proof needs."""
        if self.method == "characteristic":
            return (), None
        return exact_conditions(self.controller, self.reference, self.integrators)

    def _judged(self, conditions: tuple[Condition, ...], outcome: Outcome) -> tuple[Condition, ...]:
        if self.method == "characteristic":
            text = "for every consistent plant" if outcome.proved else "not proved for every plant"
            holds = True if outcome.proved else None
            return (
                Condition("leading coefficient keeps its sign, no zero on the circle", holds, text),
            )
        first, second, third = conditions
        if not outcome.proved:
            return first, second, third
        how = "assumed (margin)" if self.margin is not None else "proved"
        return (
            first,
            Condition(second.name, True, f"{second.text}; P is stable, {how}"),
            Condition(third.name, True, f"{_largest(outcome)} on the whole circle"),
        )

    def _assumptions(self) -> tuple[str, ...]:
        texts = [
            *self.data.assumptions,
            *self.noise.assumptions,
            f"the plant is a {self.model!r}",
            "each noise sample lies within its bound",
        ]
        if self.integrators:
            texts.append("the plant has one pole at exactly z = 1 (declared)")
        if self.margin is not None:
            least = all_digits(self.margin)
            texts.append(f"the plant's other poles have abs(z) <= 1 - {least} (margin)")
        return tuple(texts)

    # ---- verdict ------------------------------------------------------------------------

    def proved_reason(self, outcome: Outcome) -> str:
        """State what a proof over all cells says."""
        if self.method == "characteristic":
            return f"every closed loop is stable ({outcome.cells} cells)"
        return f"{_largest(outcome)} for every consistent plant"

    def fits(self, answer: StabilityCertificate) -> bool:
        """Check that an answer says in words what its numbers say, and keeps all assumptions.

        Whether the numbers are proved is another question.
        """
        arcs = tuple((low, high, bound / _ROOM) for low, high, bound in answer.arcs)
        outcome = Outcome(answer.verdict == "certified", arcs, (), answer.cells)
        exact, _ = self.exact_conditions()
        conditions = self._judged(exact, outcome)
        failed = tuple(f"{c.name} fails: {c.text}" for c in exact if c.holds is False)
        reasons = {
            "certified": (self.proved_reason(outcome),),
            "refuted": (_REFUTED,),
            "open": failed or _OPEN,
        }[answer.verdict]
        unproved = answer.verdict == "open" and not failed and _UNPROVED.fullmatch(answer.reason)
        return (
            answer.conditions == conditions
            and (answer.reason in reasons or bool(unproved))
            and (answer.plant is not None) == (answer.verdict == "refuted")
            and (answer.verdict == "open" or not answer.help)
            and set(self._assumptions()) <= set(answer.assumptions)
        )

    def _reason(
        self, found: ParameterSet | None, outcome: Outcome, plant: Transfer | None, late: bool
    ) -> str:
        if plant is not None:
            return _REFUTED
        if found is None:
            bare = self.margin is None and self.method == "small_gain"
            why = _LATE if late else _STRONG
            return f"{_WITHOUT_MARGIN}; {why}" if bare else why
        if found.empty:
            return NOTHING
        if outcome.proved:
            return self.proved_reason(outcome)
        where = ", ".join(f"{w:.3g}" for w in outcome.failing[:3])
        if self.method == "small_gain" and self.margin is None and not outcome.arcs:
            return _NOT_STABLE
        return f"no proof near {where} rad a sample; a failing proof says nothing of the loop"

    def _answer(
        self,
        found: ParameterSet | None,
        outcome: Outcome,
        reason: str,
        conditions: Sequence[Condition],
        assumptions: tuple[str, ...],
        plant: Transfer | None,
    ) -> StabilityCertificate:
        verdict: Literal["certified", "refuted", "open"] = "open"
        if outcome.proved:
            verdict = "certified"
        elif plant is not None:
            verdict = "refuted"
        arcs = tuple(sorted((low, high, b * _ROOM) for low, high, b in outcome.arcs))
        bound = max((b for *_, b in arcs), default=inf)
        if self.method == "characteristic":
            bound = float("nan")
        failed = any(c.holds is False for c in conditions)
        advice = () if verdict != "open" else self._advice(found, failed)
        return StabilityCertificate(
            verdict=verdict,
            reason=reason,
            method=self.method,
            conditions=tuple(conditions),
            bound=bound,
            arcs=arcs,
            controller=self.controller,
            reference=self.reference,
            model=self.model,
            parameters=found,
            plant=plant,
            margin=self.margin,
            integrators=self.integrators,
            assumptions=assumptions,
            help=advice,
            cells=outcome.cells,
            seconds=0.0,
            data=self.data,
            noise=self.noise,
        )

    def _advice(self, found: ParameterSet | None, failed: bool) -> tuple[str, ...]:
        if failed:  # whatever the data
            return ("method='characteristic': it asks for less than small gain",)
        texts = ["more samples, or a smaller noise bound"]
        if found is not None and found.empty:
            return ("a higher plant order, or a larger noise bound: the record refutes this one",)
        if self.margin is None:
            texts.append("a margin of the plant's poles, where it is known (margin=)")
        order, lag = self.model.na[0][0], self.model.nk[0][0]
        if order > 1:
            texts.append(f"a plant order below {order}, where that is enough")
        if lag == 0:
            texts.append("delay=1 where the plant does not react at once: one parameter less")
        if self.method == "small_gain":
            texts.append("method='characteristic': it asks for less than small gain")
        return tuple(texts)
