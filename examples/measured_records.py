"""Three measured records to the end: noise, intervals, members, report, beside least squares.

A heat exchanger, a heating system and a flexible robot arm. The first half of each record is for
estimation, the second for validation. With jax-sysid installed its linear model of the same order
is fitted to the same halves.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

import setid

FOLDER = Path(__file__).resolve().parent / "data"
RECORDS = {  # sampling time, order, delay, offset, samples of each half
    "heat_exchanger": (1.0, 2, 1, True, 500),
    "heating_system": (2.0, 2, 1, True, 400),
    "robot_arm": (1.0, 4, 1, False, 500),
}
MARGIN = 1.1  # on the least equation error of the first half: an assumption, checked on the other


def fit(measured: np.ndarray, modelled: np.ndarray) -> float:
    """100 (1 - |e| / |y - mean y|)."""
    error = np.linalg.norm(measured - modelled)
    return float(100.0 * (1.0 - error / np.linalg.norm(measured - measured.mean())))


def jax_sysid(first: setid.IOData, second: setid.IOData, order: int) -> str:
    """Fits of a linear state-space model of jax-sysid, where that is installed."""
    try:
        from jax_sysid.models import LinearModel  # type: ignore[import-not-found]
    except ImportError:
        return "jax-sysid is not installed: pip install 'sparsepop-py[jax-sysid]'"
    mean = first.u.mean(axis=0), first.y.mean(axis=0)
    size = first.u.std(axis=0), first.y.std(axis=0)
    u, y = ([(part - m) / s for part in parts] for parts, m, s in
            zip(((first.u, second.u), (first.y, second.y)), mean, size, strict=True))  # fmt: skip
    begin = time.perf_counter()
    model = LinearModel(order, 1, 1, feedthrough=False)
    model.loss(rho_x0=1e-3, rho_th=1e-4)
    model.optimization(adam_epochs=0, lbfgs_epochs=2000)
    model.fit(y[0], u[0])
    seconds, found = time.perf_counter() - begin, []
    for inputs, outputs in zip(u, y, strict=True):
        start = model.learn_x0(inputs, outputs)
        found.append(fit(outputs, np.asarray(model.predict(start, inputs)[0])))
    return f"jax-sysid, simulated: {found[0]:.1f} / {found[1]:.1f} % in {seconds:.1f} s"


def study(name: str, output: Path) -> None:
    """One record to the end."""
    Ts, order, delay, offset, half = RECORDS[name]
    data = setid.IOData.from_csv(FOLDER / f"{name}.csv", "u", "y", Ts)
    first, second = data.split(2 * half)[0].split(half) if data.samples > 2 * half else (
        data.split(half))  # fmt: skip
    model = setid.TransferFunction(na=order, nb=order, nk=delay, offset=offset)
    begin = time.perf_counter()
    least = setid.consistency(first, model, setid.Noise(equation=1.0))
    result = setid.identify(first, model, least.noise_bound(margin=MARGIN), holdout=second)
    print(f"\n{name}: {time.perf_counter() - begin:.1f} s")
    print(result.table())
    assert result.holdout is not None
    print(result.holdout.text)
    for mode in ("prediction", "simulation"):
        print(setid.compare(result, second, mode, "sampled").summary())
    print(jax_sysid(first, second, order))
    print(result.report(output / f"{name}.html", second))


def main() -> None:
    """All records, or those that are named."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="for the pages")
    parser.add_argument("--record", choices=[*RECORDS], nargs="+", default=[*RECORDS])
    given = parser.parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    for name in given.record:
        study(name, given.output)


if __name__ == "__main__":
    main()
