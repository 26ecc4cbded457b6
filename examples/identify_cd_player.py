"""A measured record with two inputs and two outputs: the arm of a CD player (DaISy).

One denominator for all four transfer functions, equation errors: everything is settled by
exact linear programs, also with many parameters.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import setid
import sparsepop_py as sp

RECORD = Path(__file__).resolve().parent / "data" / "cd_player_arm.csv"


def main() -> None:
    """Consistency level by order, intervals, validation."""
    plt.switch_backend("Agg")  # pictures go to files
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="for pictures")
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)
    data = setid.IOData.from_csv(RECORD, inputs=["u1", "u2"], outputs=["y1", "y2"])
    estimation, validation = data.split(200)

    print("least bound of the equation error, by order (proved):")
    for order in (1, 2, 3):
        level = setid.consistency(estimation, structure(order), setid.Noise(equation=0.1))
        print(f"  na = nb = {order}: {sp.rounded(0.1 * level.scale[0], False, 4)}")
    noise = setid.Noise(equation=1.05 * 0.1 * level.scale[1])
    result = setid.identify(estimation, structure(3), noise)
    print(result.table())

    comparison = setid.compare(result, validation, mode="prediction")
    print("\none step ahead, on samples that were not used:")
    print(comparison.summary())
    for name, axes in {"intervals": result.plot(), "prediction": comparison.plot()}.items():
        np.ravel(axes)[0].figure.savefig(output / f"cd_player_{name}.png", dpi=120)
    plt.close("all")

    sure = [n for n, v in result.intervals.items() if n[0] == "b" and 0.0 not in v]
    print(
        f"""
What an engineer learns: with order three about half the noise of order one has to be
assumed: a third state is in the data. The numerator coefficients of certain sign are
{", ".join(sure)};
all others may be zero: the record proves no coupling between the two loops.
The record was taken in closed loop, which does no harm to proved intervals: they ask
nothing of the input but that it was recorded."""
    )


def structure(order: int) -> setid.TransferFunction:
    """Two by two, one denominator."""
    return setid.TransferFunction(order, order, 1, 2, 2, common_denominator=True)


if __name__ == "__main__":
    main()
