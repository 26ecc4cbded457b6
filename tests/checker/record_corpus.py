"""Records of all kinds and what setid proves of them, as files for the second checker.

``python tests/checker/record_corpus.py folder [from to]`` identifies them and writes one file each.
"""

from __future__ import annotations

import functools
import json
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent.parent)]

import setid  # noqa: E402
from setid.result.certificate_files import certificate_files  # noqa: E402

Case = tuple[str, Any, Any, Any, Any]  # name, data, model, noise, priors


def response(u: np.ndarray, a: list[float], b: list[float], errors: np.ndarray) -> np.ndarray:
    """y(k) = -sum a_i y(k-i) + sum b_j u(k-j) + e(k), at rest before the record."""
    y = np.zeros(u.size)
    for k in range(u.size):
        past = sum(-c * y[k - i] for i, c in enumerate(a, 1) if k >= i)
        y[k] = past + sum(c * u[k - j] for j, c in enumerate(b) if k >= j) + errors[k]
    return y


def record(seed: int, kind: str, size: int = 10, order: int = 1, noise: float = 0.05) -> Any:
    """Data of a stable system with noise of a kind: e, o, i, or several of them."""
    rng = np.random.default_rng(seed)
    u = rng.choice([-1.0, 1.0], size) * rng.uniform(0.5, 1.5, size)
    a = [float(rng.uniform(-0.8, 0.8))] if order == 1 else [-1.1, 0.4]
    b = [float(v) for v in rng.uniform(0.5, 2.0, order)]
    errors = rng.uniform(-noise, noise, size) * ("e" in kind)
    y = response(u, a, b, errors) + rng.uniform(-noise, noise, size) * ("o" in kind)
    u = u + rng.uniform(-noise, noise, size) * ("i" in kind)
    return setid.IOData(u, y)


def noise_of(kind: str, bound: float = 0.05) -> Any:
    """The bounds that belong to :func:`record`."""
    names = {"e": "equation", "o": "output", "i": "input"}
    return setid.Noise(**{names[letter]: bound for letter in kind})


def cases() -> Iterator[Case]:
    """Over fifty records."""
    first = setid.TransferFunction(1, 1)
    for seed in range(4):
        for kind in ("e", "o", "i", "oi", "eo", "eoi"):
            yield f"{kind}-{seed}", record(seed, kind), first, noise_of(kind), ()
    second = setid.TransferFunction(2, 2)
    for seed in range(3):
        for kind in ("e", "o"):
            data = record(10 + seed, kind, 16, 2, 0.02)
            yield f"second-{kind}-{seed}", data, second, noise_of(kind, 0.02), ()
    for seed in range(3):
        data = record(20 + seed, "o")
        yield f"stable-{seed}", data, first, noise_of("o"), (setid.Stable(),)
        yield f"box-{seed}", data, first, noise_of("o"), (setid.Box({"a1": (-1, 1), "b0": (0, 3)}),)
        zero = setid.TransferFunction(1, 1, initial="zero")
        yield f"zero-{seed}", data, zero, noise_of("o"), ()
        offset = setid.TransferFunction(1, 1, offset=True)
        yield f"offset-{seed}", data, offset, noise_of("e", 0.3), ()
        relative = setid.Noise(output=0.05, relative=True)
        clean = record(20 + seed, "")
        yield f"relative-{seed}", clean, first, relative, ()
        yield f"empty-{seed}", data, first, noise_of("o", 0.002), ()
        both = setid.IOData.concat([record(30 + seed, "o", 6), record(30 + seed, "o", 7)])
        yield f"two-{seed}", both, first, noise_of("o", 0.06), ()
        sets = setid.Noise(output=0.05, constraints=[setid.EnergyBound("output", 0.2)])
        yield f"energy-{seed}", data, first, sets, ()
    yield from several()
    yield from simulated()
    yield from cones()


def simulated() -> Iterator[Case]:
    """Noisy outputs that are simulated: short ones of several structures, and two that are long."""
    priors = (setid.Box({"a1": (-0.9, 0.9), "b0": (0.1, 5)}),)
    first, zero = (setid.TransferFunction(1, 1, initial=i) for i in ("free", "zero"))
    for name, model in (("free", first), ("zero", zero)):
        for seed in range(2):
            case = record(40 + seed, "o", 16), model, noise_of("o", 0.1), priors
            yield f"simulated-{name}-{seed}", *case
    offset = setid.TransferFunction(2, 2, offset=True)
    yield "simulated-offset", record(3, "o", 30, 2, 0.01), offset, noise_of("o", 0.01), ()
    yield "long-first", record(50, "o", 230), first, noise_of("o"), ()
    second = setid.TransferFunction(2, 2)
    yield "long-second", record(51, "o", 230, 2, 0.02), second, noise_of("o", 0.02), ()


def cones() -> Iterator[Case]:
    """Noisy outputs whose denominators are parted: of order 1 to 3, of one and of two outputs."""
    first = setid.TransferFunction(1, 1, offset=True)
    yield "cones-first", record(60, "o", 40, 1, 0.2), first, noise_of("o", 0.2), ()
    second = setid.TransferFunction(2, 2)
    yield "cones-second", record(61, "o", 40, 2, 0.1), second, noise_of("o", 0.1), ()
    rng, third = np.random.default_rng(62), setid.TransferFunction(3, 1, 1)
    noise = setid.Noise(output=0.02)
    made = setid.simulate_record(third, [-1.2, 0.5, -0.1, 1.0], rng.uniform(-1, 1, 40), noise, rng)
    yield "cones-third", made.data, third, noise, (setid.Stable(),)
    two = setid.TransferFunction([[1], [1]], 1, inputs=1, outputs=2)
    noise = setid.Noise(output=0.1)
    made = setid.simulate_record(two, [-0.7, 0.4, 1.0, 2.0], rng.uniform(-1, 1, 40), noise, rng)
    yield "cones-outputs", made.data, two, noise, ()
    rest, noise = setid.TransferFunction(2, 1, 1, initial="zero"), setid.Noise(output=0.05)
    made = setid.simulate_record(rest, [-1.1, 0.4, 1.0], rng.uniform(-1, 1, 40), noise, rng)
    yield "cones-rest", made.data, rest, noise, (setid.Stable(),)


LARGE = ("two-poles-driven", "two-poles-offset", "hammerstein", "wiener", "lure")


def identified(case: Case, seconds: float) -> Any:
    """What setid proves of a case; simulated ones and those of cones are treated as if long."""
    short = case[0].startswith(("simulated", "cones"))
    few = mock.patch("setid.bounding.long_records._MANY", 5 if short else 200)
    wide = mock.patch("setid.bounding.simulations._WIDE_BOX", 0.0)  # cones, whatever the box
    none = mock.patch("setid.bounding.simulations.denominator_box", return_value=None)
    simulated_only = none if case[0].startswith("simulated") else nullcontext()
    with warnings.catch_warnings(), few, wide, simulated_only:
        warnings.simplefilter("ignore")
        large = case[0].startswith(LARGE)  # narrow intervals cost much and prove nothing else
        tol = 0.3 if case[0].startswith("cones") else 0.1 if large else 1e-3
        options = setid.Options(tol=tol, time_limit=seconds, progress=False)
        return setid.identify(*case[1:], options=options)


def strong(kind: str) -> Case:
    """A short record whose noise is so strong that rows one by one give no bounds."""
    rng = np.random.default_rng(28)
    u = rng.uniform(-1, 1, 10)
    model = setid.TransferFunction(2, 1, 1)
    made = setid.simulate_record(model, [-0.6, 0.3, 1.0], u, setid.Noise(output=0.35), rng)
    noise = setid.Noise(output=0.35, input=0.01) if "i" in kind else setid.Noise(output=0.35)
    return f"strong-{kind}", made.data, model, noise, ()


def several() -> Iterator[Case]:
    """Several channels, strong noise, missing samples, structures that come as rows."""
    second = setid.TransferFunction(2, 2)
    rng = np.random.default_rng(5)
    u = rng.choice([-1.0, 1.0], (14, 2))
    y = response(u[:, 0], [-0.5], [1.0], np.zeros(14)) + response(
        u[:, 1], [0.3], [0.5], np.zeros(14)
    )
    y = y + rng.uniform(-0.02, 0.02, 14)
    two = setid.IOData(u, y)
    common = setid.TransferFunction(1, 2, inputs=2, common_denominator=True)
    yield "common", two, common, setid.Noise(equation=1.5), ()
    apart = setid.TransferFunction(1, 1, inputs=2)
    poles = setid.Box({"a[1,1]1": (-0.9, 0.9), "a[1,2]1": (-0.9, 0.9)})
    wide = setid.Box({"b[1,1]0": (-3, 3), "b[1,2]0": (-3, 3)})
    yield "apart", two, apart, setid.Noise(output=0.02), (poles, wide)
    for kind in ("o", "oi"):
        noise = noise_of(kind, 0.02)
        yield f"two-poles-{kind}", two, apart, noise, ()
        yield f"two-poles-{kind}-stable", two, apart, noise, (setid.Stable(),)
        yield strong(kind)
    moved = setid.IOData(u, y + 1.0)
    for form in ("auto", "direct", "multiplied", "lifted"):
        offset = setid.TransferFunction(1, 1, inputs=2, offset=True, form=form)
        yield f"two-poles-offset-{form}", moved, offset, noise_of("o", 0.02), (setid.Stable(),)
    for prior in (setid.Stable(), setid.Box({"a[1,1]1": (-1, 1), "a[1,2]1": (-1, 1)})):
        name = "two-poles-driven" + ("-box" if isinstance(prior, setid.Box) else "")
        offset = setid.TransferFunction(1, 1, 1, inputs=2, offset=True)
        noise, rest = setid.Noise(output=0.03), np.random.default_rng(6).uniform(-1, 1, (40, 2))
        made = setid.simulate_record(offset, [-0.8, -0.5, 1.0, 0.6, 3.0], rest, noise, 6).data
        yield name, setid.IOData(made.u[30:], made.y[30:]), offset, noise, (prior,)
    yield "wide-second", record(3, "oi", 20, 2, 0.3), second, noise_of("oi", 0.3), ()
    data = record(7, "o", 12)
    gone = data.y.ravel().copy()
    gone[5] = np.nan
    yield "gap", setid.IOData(data.u, gone), setid.TransferFunction(1, 1), noise_of("o"), ()
    known = setid.IOData(data.u, gone, y_range=(-20, 20))
    yield "gap-range", known, setid.TransferFunction(1, 1), noise_of("o"), ()
    narx = setid.PolynomialNARX(["y1", "u0", "y1*u0"], 1, 0)
    yield "narx", record(8, "e", 14), narx, noise_of("e"), ()
    yield from structures()


def structures() -> Iterator[Case]:
    """One record of each structure whose rows come with the file."""
    shape, ends = setid.TransferFunction(1, 1, 1), setid.Box({"b1": (0.5, 1.5), "a1": (-0.9, 0.0)})
    models = {
        "hammerstein": (setid.Hammerstein(shape, 2, normalise="gamma1"), [-0.5, 1.0, 0.3]),
        "wiener": (setid.Wiener(shape, 2, normalise="b1", initial="zero"), [-0.5, 1.0, 0.3]),
        "lure": (setid.Lure(shape, 2, normalise="nolinear"), [-0.5, 1.0, 0.1]),
    }
    for name, (model, theta) in models.items():
        rng = np.random.default_rng(9)
        u, noise = rng.uniform(-1, 1, 10), setid.Noise(output=0.02)
        made = setid.simulate_record(model, theta, u, noise, rng)
        gains = {"a1": (-0.9, 0.0), "gamma1": (0.5, 1.5), "gamma2": (0.0, 1.0)}
        yield name, made.data, model, noise, (setid.Box(gains) if name == "wiener" else ends,)
    continuous = setid.ContinuousTransferFunction(1, 0, Ts=1.0)
    rng, noise = np.random.default_rng(10), setid.Noise(equation=0.02)
    made = setid.simulate_record(continuous, [0.5, 1.0], rng.uniform(-1, 1, 14), noise, rng)
    yield "continuous", made.data, continuous, noise, ()


@functools.cache
def written(name: str) -> str:
    """The file of one record."""
    case = next(case for case in cases() if case[0] == name)
    found = identified(case, 20.0)
    assert found.verify(case[1])
    return json.dumps(certificate_files(found))


def main(folder: Path, begin: int, end: int) -> None:
    """Identify and write."""
    folder.mkdir(parents=True, exist_ok=True)
    for case in list(cases())[begin:end]:
        started = time.time()
        found = identified(case, 8.0)
        (folder / f"{case[0]}.json").write_text(json.dumps(certificate_files(found)))
        print(f"{case[0]}: {found.status}, {time.time() - started:.1f} s", flush=True)


if __name__ == "__main__":
    first_, last_ = (int(v) for v in sys.argv[2:4]) if len(sys.argv) > 3 else (0, 10**6)
    main(Path(sys.argv[1]), first_, last_)
