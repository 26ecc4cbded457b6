"""Check of noise bounds on a part of the record that was held out."""

from __future__ import annotations

from dataclasses import dataclass

from setid.data.record import IOData
from setid.formulation.printing import rounded

__all__ = ["Holdout"]


@dataclass(frozen=True, slots=True, eq=False)
class Holdout:
    """Verdict of a held-out record on an identified set.

    Parameters
    ----------
    data : IOData
        The samples that were held out.
    scale : (float, float)
        Least factor on the noise bounds with which members of the outer box explain these
        samples: proved up to the first, attained at the second.

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

    data: IOData
    scale: tuple[float, float]

    @property
    def holds(self) -> bool | None:
        """True if the bounds explain the samples, False if they are refuted, None if open."""
        low, high = self.scale
        return True if high <= 1.0 else (False if low > 1.0 else None)

    @property
    def text(self) -> str:
        """One sentence."""
        low, high = rounded(self.scale[0], False, 4), rounded(self.scale[1], True, 4)
        what = {
            True: "the noise bounds hold on the part that was held out",
            False: "the noise bounds are refuted by the part that was held out",
            None: "whether the noise bounds hold on the part that was held out is open",
        }[self.holds]
        return (
            f"{what} ({self.data.samples} samples): they need {low} (proved) to {high} (attained) "
            "times the bounds"
        )
