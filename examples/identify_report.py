"""From a CSV file to a page: a hair dryer, its noise bound, what it is worth, and the report.

The page needs ``pip install 'sparsepop-py[report]'``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import setid

RECORD = Path(__file__).parent / "data" / "hairdryer.csv"


def main() -> None:
    """Identify on one half, check on the other, write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="for the page")
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)
    record = setid.IOData.from_csv(RECORD, inputs="u", outputs="y", Ts=0.08)
    first, second = record.split(200)
    model = setid.TransferFunction(na=2, nb=2, nk=3, offset=True)

    # the least one-step error that explains the first half, with a margin: read off that half
    least = setid.consistency(first, model, setid.Noise(equation=1.0))
    noise = least.noise_bound(margin=1.2)
    result = setid.identify(first, model, noise, [setid.Stable()], holdout=second)
    print(result.table())
    assert result.holdout is not None
    print(result.holdout.text)

    # how much larger may the noise be until signs are lost?
    print("\n".join(result.sensitivity(factors=[1.0]).summary().splitlines()[-6:]))

    # a member for simulation, beside the centre and least squares
    print(setid.compare(result, second, kind="sampled").summary())

    print(result.report(output / "hairdryer.html", second))


if __name__ == "__main__":
    main()
