"""Outcome of a search for a proved band, in numbers and words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sparsepop_py.verified.arithmetic.display import rounded

__all__ = ["FLOOR", "BandReport", "Kind", "Verdict", "ratio_of"]

Kind = Literal["proved", "sampled"]
Reals = NDArray[np.float64]
Verdict = Literal["tight", "wide", "unstable", "unproved"]
_EXPLAINED = 3.0  # ratio from which a reader is told why
FLOOR = 0.01  # of the largest attained width: narrower samples do not count by themselves


@dataclass(frozen=True, slots=True)
class BandReport:
    """Width of a proved band beside what members attain, and why.

    Parameters
    ----------
    verdict : {"tight", "wide", "unstable", "unproved"}
        ``"tight"``: within the tolerance of what points of the cover attain (members, where the
        cover is the feasible set). ``"wide"``: finite, but the search ended before that. Where the
        band is infinite or grows beyond 1000 times what is attained: ``"unstable"`` where a member
        is, and ``"unproved"`` where the stability of a cell was not proved.
    cells : int
        Number of cells of the denominator's parameters that were looked at.
    left : int
        Number of those whose union is the band.
    growing : int
        Number of these whose bounds grow with time: their stability is not proved.
    ratio : float
        Largest ratio of the proved width to the attained one, over samples where the latter is at
        least 1 % of its largest value; NaN where nothing is attained, or no width.
    pole_radius : float
        Largest absolute value of a pole of the members that were simulated; NaN without one.
    seconds : float
        Wall time.
    spent : bool
        Whether more time would not have led to more cells: their largest number was reached, was
        forecast where there is no time limit, or a cell is as narrow as rounding errors.

    Examples
    --------
    >>> import setid
    >>> data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    >>> result = setid.identify(data, setid.TransferFunction(1, 1), setid.Noise(equation=0.5))
    >>> report = setid.step_band(result, 3).report
    >>> report.verdict, report.cells, report.ratio < 1.25
    ('tight', 1, True)
    """

    verdict: Verdict
    cells: int
    left: int
    growing: int
    ratio: float
    pole_radius: float
    seconds: float
    spent: bool = False

    @property
    def text(self) -> str:
        """One sentence for people."""
        ratio = rounded(self.ratio, True, 3)
        size = f"{self.left} of {self.cells} cells, {self.seconds:.1f} s"
        if np.isnan(self.ratio) and self.verdict in ("tight", "wide"):
            return f"no attained width to compare the proved one with ({size})"
        if self.verdict == "tight":
            text = f"proved width at most {ratio} times the attained one ({size})"
            if self.ratio > _EXPLAINED:
                text += (
                    "; it follows what is proved of the parameters, which is wide beside the "
                    "members: where intervals are open, more time for identify narrows it"
                )
            return text
        if self.verdict == "wide":
            over = "no further cells are tried" if self.spent else "time is over"
            text = f"{over} at a proved width of up to {ratio} times the attained one"
            if self.pole_radius > 1.0:
                text += f"; a member is unstable, with a pole of radius {self.pole_radius:.6g}"
            helps = "a Stable prior or a shorter record helps"
            return f"{text} ({size}); {helps if self.spent else 'a larger time_limit narrows it'}"
        without = "the band is infinite or grows towards it"
        if self.verdict == "unstable":
            return (
                f"{without}: a member is unstable, with a pole of radius {self.pole_radius:.6g} "
                f"({size}); a Stable prior or a shorter record helps"
            )
        unproved = f"{without}: the stability of {self.growing} cells is not proved"
        if self.spent:
            return (
                f"{unproved}, and no further ones are tried ({size}); a Stable prior with a "
                "margin or a shorter record helps"
            )
        return (
            f"{unproved} in the time given ({size}); a larger time_limit or a Stable prior with a "
            "margin helps"
        )

    @staticmethod
    def merged(reports: Sequence[BandReport]) -> BandReport:
        """Merge the reports of several outputs or records."""
        order: list[Verdict] = ["tight", "wide", "unproved", "unstable"]
        ratios = [r.ratio for r in reports]
        radii = [r.pole_radius for r in reports]
        worst = max((r.verdict for r in reports), key=order.index)
        return BandReport(
            worst,
            sum(r.cells for r in reports),
            sum(r.left for r in reports),
            sum(r.growing for r in reports),
            float(np.fmax.reduce(ratios)),
            float(np.fmax.reduce(radii)),
            sum(r.seconds for r in reports),
            all(r.spent for r in reports if r.verdict == worst),
        )


def ratio_of(proved: tuple[Reals, Reals], attained: tuple[Reals, Reals]) -> float:
    """Find the largest ratio of widths, where the attained width counts; else NaN.

    Parameters
    ----------
    proved, attained : (low, high), each (N,) float
        Attained widths count from :data:`FLOOR` times the largest of them on.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        widths = proved[1] - proved[0], attained[1] - attained[0]
    top = float(np.max(widths[1], initial=0.0))
    counted = widths[1] > FLOOR * top
    if not np.isfinite(top) or not np.any(counted):
        return float("nan")
    return float(np.max(widths[0][counted] / widths[1][counted]))
