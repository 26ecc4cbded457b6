"""Settings of bounds from single relaxations."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["BOUNDING", "BoundingSettings"]


@dataclass(frozen=True)
class BoundingSettings:
    """Settings of bounds from single relaxations: numbers of experience.

    They decide accuracies and what is tried, never whether a bound is valid. Numbers without
    another source are rules of thumb, chosen on the benchmark families.

    Parameters
    ----------
    bits : tuple of int
        Binary places that entries of Gram matrices are rounded to.
    interior_bits : tuple of int
        The same for definite matrices, most first: integers that they are multiplied by leave few.
    shift : float
        Relative shift that keeps singular matrices from stopping an estimate.
    kernel_ridge : float
        Relative weight that keeps entries near 0 which the equations of a minimiser leave open.
    trace : float
        Weight of the trace beside the constant: it prefers few squares.
    short_shares : tuple of float
        Shares of the largest multiplier; smaller ones may be left out.
    likely : float
        Share of the allowed gap by which a solver's value closes it, for multipliers to be
        shortened before any proof.
    short_loss : float
        Share of its gain that a bound of a variable may lose to shorter multipliers.
    rough_accuracy : float
        Accuracy that is enough of a solver whose gap is that of its safe value.
    rounded_accuracy : float
        Accuracy that is enough of a solver whose matrices are rounded to ``bits``.
    alike : float
        Share of the rows of a program that are left at most where alike blocks are merged.
    merged_accuracy : float
        Accuracy of programs of merged blocks, which take no time.
    moments : int
        Moments from which residuals add up to more than the gap that a solver leaves.
    margins : tuple of float
        Margins tried without a box, relative to the scaled objective.
    accuracies : tuple of float
        Accuracies at which solvers stop, one after the other.
    interior_steps : tuple of float
        Steps from the most accurate matrices into the interior.
    many_variables : int
        Variables from which a box takes too long to gain the last digits.
    small_gap : float
        Relative gap that is nearly closed, with many variables.
    few_monomials : int
        Monomials up to which rational elimination takes no time.
    smaller_blocks : float
        Share of the largest block: blocks of the monomials that occur are tried if no larger.
    denominators : int
        Largest denominator of coordinates that exact bounds are expected at.
    far_incumbent : float
        Relative gap at which a better point is looked for before a relaxation is solved.
    linear_entries : int
        Entries of a matrix of linear rows up to which it is formed densely.
    convex_entries : int
        Entries of the Hessian up to which a quadratic objective is recognised as convex.
    convex_variables : int
        Variables up to which its eigenvalues are computed; larger matrices are factorized.
    lost : float
        Share of a solver's value; where the proof loses more, it is tried on another box.
    convex_accuracy : float
        Accuracy of multipliers that rationals take the place of.
    exact_variables : int
        Variables up to which the simplex method in integers takes no time.
    """

    bits: tuple[int, ...] = (0, 2, 6, 12)
    interior_bits: tuple[int, ...] = (40, 32, 24)
    shift: float = 1e-10
    kernel_ridge: float = 1e-12
    trace: float = 0.1
    short_shares: tuple[float, ...] = (1e-5, 1e-7, 1e-9)
    likely: float = 0.05
    short_loss: float = 0.01
    rough_accuracy: float = 5e-3
    rounded_accuracy: float = 1e-5
    alike: float = 0.1
    merged_accuracy: float = 1e-7
    moments: int = 100
    margins: tuple[float, ...] = (1e-8, 1e-6, 1e-4)
    accuracies: tuple[float, ...] = (1e-7, 1e-6, 1e-5, 1e-4)
    interior_steps: tuple[float, ...] = (1e-3, 1e-2, 1e-1, 1.0)
    many_variables: int = 300
    small_gap: float = 1e-4
    few_monomials: int = 40
    smaller_blocks: float = 0.5
    denominators: int = 12
    far_incumbent: float = 0.01
    linear_entries: int = 1_000_000
    convex_variables: int = 1000
    convex_entries: int = 250_000
    lost: float = 1e-7
    convex_accuracy: float = 1e-10
    exact_variables: int = 40


BOUNDING = BoundingSettings()
