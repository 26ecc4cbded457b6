"""The main job: problem files in, proved bounds, attained points and pictures out.

Every problem in ``examples/problems`` is solved at order 2, and at order 3 where the gap
is still open. Each certificate is then checked again, without a solver. The end is a measured
record: certified intervals of its model, and a proved band of its frequency response.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

import identify_hairdryer
import matplotlib.pyplot as plt

import setid
import sparsepop_py as sp

HERE = Path(__file__).resolve().parent
COLUMNS = "{:<16}{:>3}  {:<5}  {:>5}  {:<9}{:>15}{:>16}{:>9}{:>8}  {:>8}"
HEAD = COLUMNS.format(
    *("problem", "n", "sense", "order", "status"),
    *("proved bound", "attained value", "gap", "CPU s", "verified"),
)


def main() -> None:
    """Solve every problem, print the table, draw."""
    plt.switch_backend("Agg")  # pictures go to files
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="for pictures")
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)
    print(HEAD)
    print("-" * len(HEAD))
    for path in sorted((HERE / "problems").glob("*.gms")):
        problem = sp.read_gms(path)
        start = time.process_time()
        for order in (2, 3):
            result = sp.solve(problem, sp.Options(order=order))
            if result.status is not sp.Status.BOUNDED:
                break
        seconds = time.process_time() - start
        print(row(path.stem, order, result, seconds))
        plt.close(draw(result, output / f"{path.stem}.png"))
    print()
    print("proved bound    no feasible point has a better value (lower bound of a minimum)")
    print("attained value  a feasible point that provably exists has this value or a better one")
    print("verified        the certificate, checked again from the problem's numbers")
    print()
    measured(output)
    print(f"pictures        {output}/*.png")


def measured(output: Path) -> None:
    """Intervals and Bode band of the hair dryer."""
    print("a measured record: the hair dryer of DaISy (examples/data/SOURCES.txt)")
    result, validation = identify_hairdryer.identified()
    print(result.table())
    print(f"verified        {'yes' if result.verify() else 'no'}, again from the data")
    comparison = setid.compare(result, validation, mode="prediction")
    print(f"validation      {comparison.summary().splitlines()[-1]}")
    for name, axes in {
        "hairdryer_intervals": result.plot(),
        "hairdryer_bode": setid.frequency_band(result).plot("bode")[0],
    }.items():
        axes.figure.savefig(output / f"{name}.png", dpi=120)
        plt.close(axes.figure)


def row(name: str, order: int, result: sp.Result, seconds: float) -> str:
    """One line of the table, in the sense of the file (min or max)."""
    problem, certificate = result.problem, result.certificate
    maximise = problem.sense == "max"
    sign = -1.0 if maximise else 1.0
    proved, attained = sign * result.lower_bound, sign * result.upper_bound
    verified = certificate is not None and certificate.verify(problem).ok
    gap = f"{result.gap:.1e}" if math.isfinite(result.gap) else "open"
    return COLUMNS.format(
        *(name, problem.dimension, problem.sense, order, result.status),
        *(sp.rounded(proved, maximise), sp.rounded(attained, not maximise), gap),
        *(f"{seconds:.2f}", "yes" if verified else "no"),
    )


def draw(result: sp.Result, path: Path) -> plt.Figure:
    """Contours and points in two variables, else the pattern of the cliques."""
    figure = result.plot().figure
    figure.savefig(path, dpi=120)
    return figure


if __name__ == "__main__":
    main()
