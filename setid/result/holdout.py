"""Check of noise bounds on a part of the record that was held out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from setid.data.noise import Noise
from setid.data.record import IOData
from setid.formulation.formulation import Formulation, formulate
from setid.minimum_noise.consistency_result import READ_OFF, ends_of
from setid.models.continuous import without_delta
from setid.models.general import from_unknown_start
from setid.priors import Box
from setid.proofs.evidence import Verification
from setid.proofs.intervals import ParameterInterval
from setid.proofs.least_noise.noise_scale import NoiseScale, scaled_noise, verify_scale

__all__ = ["Holdout", "priors_with_box", "stated"]

Intervals = Mapping[str, ParameterInterval]


@dataclass(frozen=True, slots=True, eq=False)
class Holdout:
    """Verdict of a held-out record on the outer box of an identification.

    The box holds every vector that explains the samples identified from, and others too. So
    ``holds`` may be True while no single vector explains both parts. Where a proved band shows
    that, :func:`setid.compare` says that the assumptions are falsified.

    Parameters
    ----------
    level : NoiseScale
        Least factor on the noise bounds with which members of the outer box explain the record
        that was held out, with its evidence.

    Examples
    --------
    >>> import setid
    >>> u = [1, -1, 2, 0, 1, -2, 1, 3]
    >>> y = setid.simulate(setid.TransferFunction(1, 1), [-0.5, 1], u)
    >>> model, noise = setid.TransferFunction(1, 1), setid.Noise(equation=0.1)
    >>> result = setid.identify(setid.IOData(u, y), model, noise, holdout=0.5)
    >>> result.holdout.holds
    True
    """

    level: NoiseScale

    @property
    def data(self) -> IOData:
        """The samples that were held out."""
        return self.level.formulation.data

    @property
    def scale(self) -> tuple[float, float]:
        """The least factor: proved up to the first, attained at the second."""
        return self.level.scale

    @property
    def holds(self) -> bool | None:
        """True if some vector of the outer box explains the samples within the noise bounds.

        False where that is refuted, None where it is open.
        """
        return self.level.explains

    @property
    def text(self) -> str:
        """One sentence: the verdict, what it was asked of, and the least factor."""
        what, who = {
            True: (
                "the noise bounds hold on the part that was held out",
                "some vector of the outer box explains it, perhaps none that explains the samples "
                "identified from as well",
            ),
            False: (
                "the noise bounds are refuted by the part that was held out",
                "no vector of the outer box explains it",
            ),
            None: (
                "whether the noise bounds hold on the part that was held out is open",
                "no vector of the outer box is known to explain it, nor is that refuted",
            ),
        }[self.holds]
        factor = f"least factor on {self.level.noise.scaled}: {ends_of(self.scale, 4)}"
        text = f"{what} ({self.data.samples} samples): {who}; {factor}"
        if any(READ_OFF in said for said in self.level.noise.assumptions):
            text += "; that is a test only where the bounds were not read off this part as well"
        return text

    def verify(self, known: Formulation, intervals: Intervals) -> Verification:
        """Check both ends again, for members of the outer box of an identification.

        Parameters
        ----------
        known : Formulation
            Of the identification. Bounds that it gives one a sample say nothing of other samples.
        intervals : mapping of str to ParameterInterval
        """
        level = self.level
        if not _same_bounds(level.noise, known.noise, known.data.samples):
            return Verification(False, "held-out samples: the noise is not that of the result")
        if self.data.Ts != known.data.Ts:
            return Verification(False, "held-out samples: the sampling time is another one")
        again = stated(known, intervals, self.data, level.noise, level.limit)
        verdict = verify_scale(replace(level, formulation=again))
        return verdict if verdict else Verification(False, f"held-out samples: {verdict.reason}")


def priors_with_box(known: Formulation, intervals: Intervals) -> list[Any]:
    """Collect the priors of an identification, with its outer box as another.

    Parameters
    ----------
    known : Formulation
    intervals : mapping of str to ParameterInterval
    """
    ends = {n: i.outer for n, i in intervals.items() if np.any(np.isfinite(i.outer))}
    return [*known.priors, *([Box(ends)] if ends else [])]


def stated(
    known: Formulation, intervals: Intervals, data: IOData, noise: Noise, limit: float
) -> Formulation:
    """State the problem of held-out samples for outer-box members, with noise at its limit.

    Parameters
    ----------
    known : Formulation
        Of the identification.
    intervals : mapping of str to ParameterInterval
    data : IOData
        The samples that were held out.
    noise : Noise
        At a factor of 1.
    limit : float
        The factor.
    """
    model = from_unknown_start(known.model)  # a part goes on from the one before it
    given = priors_with_box(known, intervals)
    return formulate(data, without_delta(model), scaled_noise(noise.bounds(data), limit), given)


def _same_bounds(one: Noise, other: Noise, samples: int) -> bool:
    """Compare bounds, but for those of ``other`` that are given one a sample."""
    kinds = [(getattr(one, kind), getattr(other, kind)) for kind in ("output", "input", "equation")]
    alike = [np.shape(b)[:1] == (samples,) or np.array_equal(a, b) for a, b in kinds]
    rest = (one.relative, one.model_error) == (other.relative, other.model_error)
    return rest and all(alike)
