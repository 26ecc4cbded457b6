"""The safe value of the clique-tree method beside Clarabel's, on relaxations of all origins.

    OMP_NUM_THREADS=1 python -m benchmarks.agreement [--origins chains ...] [--kernels numpy]

The safe value is the dual value less the largest effect of the dual residual, of negative
multipliers and of negative eigenvalues on moments in [-1, 1]; Clarabel's is that of the better
of its two forms. ``loss`` is what the clique-tree method lacks, relative to max(1, |value|);
the box scale is the range of the objective on moments in [-1, 1], sum |q|, where that is larger.
"Fallback" are the programs that do not end ``solved`` (or ``infeasible``) and go to Clarabel.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sparsepop_py.conic.program import ConicProgram, ConicSolution
from sparsepop_py.solvers import cliquetree, solve_conic

from .problems.relaxations import NAMED, ORIGINS, Case, cases

__all__ = ["Agreement", "compare", "safe_value"]

CLOSE = 1e-6


@dataclass(frozen=True)
class Agreement:
    """How one program ended in both solvers.

    Parameters
    ----------
    case : Case
    own, other : ConicSolution
        Of the clique-tree method and of the better form of Clarabel.
    loss : float
        Safe value that is lacking, relative to max(1, |value|); negative if it is better.
    box_loss : float
        The same, relative to max(1, sum |q|).
    """

    case: Case
    own: ConicSolution
    other: ConicSolution
    loss: float
    box_loss: float

    @property
    def falls_back(self) -> bool:
        """Whether the program goes to Clarabel."""
        return self.own.status not in ("solved", "infeasible")

    @property
    def agrees(self) -> bool:
        """Whether the safe value is as good as Clarabel's, or both found the set empty."""
        if "infeasible" in (self.own.status, self.other.status):
            return self.own.status == self.other.status
        return self.box_loss <= CLOSE


def safe_value(program: ConicProgram, z: np.ndarray) -> float:
    """Dual value less the largest effect of the residual and of eigenvalues below zero."""
    cones, loss = program.cones, float(np.abs(program.q + program.A.T @ z).sum())
    offset = cones.zero + cones.nonnegative
    loss += 2 * float(np.maximum(0.0, -z[cones.zero : offset]).sum())
    for size in cones.psd:
        j, i = np.tril_indices(size)
        matrix = np.zeros((size, size))
        matrix[j, i] = z[offset : offset + i.size] * np.where(i == j, 1.0, np.sqrt(0.5))
        loss += size * max(0.0, -float(np.linalg.eigvalsh(matrix)[0]))
        offset += i.size
    return program.offset - float(program.b @ z) - loss


def compare(case: Case, kernels: str = "auto") -> Agreement:
    """Solve one program by both."""
    program = case.build()
    settings = cliquetree.Settings(kernels=kernels)  # type: ignore[arg-type]
    own = cliquetree.run(program, settings=settings).solution
    others = [solve_conic(program, form) for form in ("clarabel", "clarabel-moment")]
    if case.origin == "empty":
        other = next((s for s in others if s.status == "infeasible"), others[0])
    else:
        other = max(others, key=lambda s: safe_value(program, s.z))
    lacking = safe_value(program, other.z) - safe_value(program, own.z)
    value = max(1.0, abs(other.primal))
    return Agreement(
        case, own, other, lacking / value, lacking / max(value, float(np.abs(program.q).sum()))
    )


def _lines(origin: str, found: list[Agreement]) -> Iterator[str]:
    ended = [a.own.status for a in found]
    judged = [a for a in found if a.own.status != "infeasible" and not a.falls_back]
    cells = [origin, str(len(found))]
    cells += [str(ended.count(s)) for s in ("solved", "infeasible", "almost", "failed")]
    cells.append(f"{max((a.loss for a in judged), default=0.0):.0e}")
    cells.append(f"{max((a.box_loss for a in judged), default=0.0):.0e}")
    cells.append(str(sum(not a.agrees for a in judged)))
    own, other = (
        sum(x) for x in zip(*((a.own.seconds, a.other.seconds) for a in found), strict=True)
    )
    cells.append(f"{own:.1f} / {other:.1f}")
    yield "| " + " | ".join(cells) + " |"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.agreement", description=__doc__)
    parser.add_argument("--origins", nargs="+", choices=ORIGINS, default=list(ORIGINS))
    parser.add_argument("--kernels", choices=("auto", "numpy", "numba"), default="auto")
    parser.add_argument("--every", type=int, default=1, help="take each k-th program only")
    chosen = parser.parse_args()
    head = ["origin", "programs", "solved", "infeasible", "almost", "failed", "worst loss"]
    head += ["on the box scale", "disagree", "CPU s, own / Clarabel"]
    print("| " + " | ".join(head) + " |\n" + "|---" * len(head) + "|")
    every: list[Agreement] = []
    for origin in chosen.origins:
        found = [compare(c, chosen.kernels) for c in cases([origin])[:: chosen.every]]
        every += found
        for line in _lines(origin, found):
            print(line, flush=True)
    named = [a for a in every if a.case.origin in NAMED]
    print(f"\n{len(every)} programs, {sum(a.falls_back for a in every)} fall back; of the")
    print(f"{len(named)} of {' and '.join(NAMED)}: {sum(a.falls_back for a in named)}.\n")
    for a in every:
        if a.falls_back or not a.agrees:
            print(
                f"{a.case.origin}: {a.case.name}: {a.own.status} ({a.own.detail}), Clarabel "
                f"{a.other.status}; loss {a.loss:.1e}, on the box scale {a.box_loss:.1e}"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())
