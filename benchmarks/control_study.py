"""Simulated plants: how often a central controller is stable, and how often that is certified.

    python -m benchmarks.control_study --plants 200 --output study.csv
    python -m benchmarks.control_study --summary study.csv

A plant's rows are written together. A run goes on where the file ends: plants that it holds are not
computed again, and rows of a plant that was interrupted are dropped.

Plants of order 2 to 4, minimum and non-minimum phase, with and without an integrator, each at three
signal-to-noise ratios. The reference model has the zeros outside the circle that the plant
has, and the controller class is that of the ideal controller. The true plant is consistent with
every record by construction, so that a certificate of an unstable loop would be a false one.
"""

from __future__ import annotations

import argparse
import csv
import time
from collections import Counter
from pathlib import Path

import numpy as np

import setid
from setid import control
from setid.control.references import stabilises

LEVELS = (60.0, 40.0, 25.0)  # dB
SAMPLES = 100
DESIGN, PROOF = 1.0, 2.0  # seconds for the engine, and for each certificate
FIELDS = ["plant", "order", "zeros", "integrator", "snr", "designed", "centre", "stable", "fit"]
FIELDS += ["small_gain", "bound", "small_gain_s", "characteristic", "characteristic_s", "design_s"]


def plant(number: int) -> tuple[control.Transfer, np.ndarray, bool]:
    """A random plant, its real zeros outside the circle, and whether it has an integrator."""
    rng = np.random.default_rng(number)
    order, outside, integrator = 2 + number % 3, bool(number // 3 % 2), bool(number // 6 % 2)
    poles: list[complex] = [1.0] if integrator else []
    while len(poles) < order:
        size = rng.uniform(0.5, 0.95)
        if order - len(poles) >= 2 and rng.random() < 0.5:
            angle = rng.uniform(0.2, 2.5)
            poles += [size * np.exp(1j * angle), size * np.exp(-1j * angle)]
        else:
            poles.append(size)
    zeros = list(rng.uniform(-0.8, 0.8, order - 1))
    far = np.array([rng.uniform(1.3, 3.0)]) if outside else np.zeros(0)
    if outside:
        zeros[0] = far[0]
    top, below = np.poly(zeros), np.poly(poles).real
    if integrator:  # a pole at exactly z = 1
        below[-1] = -below[:-1].sum()
    gain = abs(np.polyval(below, 1.0 if not integrator else 1.3) / np.polyval(top, 1.0))
    return control.Transfer([0.0, *(gain * top)], below), far, integrator


def cases(number: int) -> list[dict[str, object]]:
    """One plant at all noise levels."""
    P, far, integrator = plant(number)
    M = control.reference_model(rise=6.0, zeros=far)
    ideal = control.ideal_controller(P, M)
    rng = np.random.default_rng(1000 + number)
    r = rng.uniform(-1.0, 1.0, SAMPLES)
    y, unit = P.simulate(r), rng.uniform(-1.0, 1.0, SAMPLES)
    rows = []
    for snr in LEVELS:
        bound = float(np.sqrt(3.0 * np.var(y) / 10.0 ** (snr / 10.0)))
        data = setid.IOData(r, y + bound * unit)
        row: dict[str, object] = {"plant": number, "order": P.order, "snr": snr}
        row |= {"zeros": "outside" if far.size else "inside", "integrator": integrator}
        rows.append(row | one(data, P, M, ideal, bound, integrator))
    return rows


def one(
    data: setid.IOData,
    P: control.Transfer,
    M: control.Transfer,
    ideal: control.Transfer,
    bound: float,
    integrator: bool,
) -> dict[str, object]:
    """Design, truth, and both certificates of one record."""
    order = round_order(ideal, far=P)
    options = setid.Options(time_limit=DESIGN, progress=False)
    begin = time.perf_counter()
    found = control.design(data, M, control.LTI(order, not integrator), bound, options=options)
    row: dict[str, object] = {"design_s": round(time.perf_counter() - begin, 2), "designed": False}
    if found.empty:
        return row
    finite = all(np.isfinite(item.width) for item in found.intervals.values())
    row["centre"] = finite  # else the estimate, of which nothing is proved
    K = found.centre if finite else found.estimate
    row |= {"designed": True, "stable": stabilises(K, P)}
    row["fit"] = round(control.check_matching(P, K, M).fit, 2)
    for method in ("small_gain", "characteristic"):
        answer = control.stability_certificate(
            data, K, M, P.order, bound, method=method, delay=1,
            integrators=int(integrator), time_limit=PROOF,
        )  # fmt: skip
        row |= {method: answer.verdict, f"{method}_s": round(answer.seconds, 2)}
        if method == "small_gain":
            row["bound"] = f"{answer.bound:.4g}"
    return row


def round_order(ideal: control.Transfer, far: control.Transfer) -> int:
    """Order of the ideal controller once zeros of M and P that agree to rounding are cancelled."""
    outside = int(np.sum(np.abs(far.zeros) > 1.0))
    poles, zeros = ideal.poles, ideal.zeros
    same = sum(bool(np.any(np.abs(poles - z) < 1e-7 * abs(z))) for z in zeros if abs(z) > 0.999)
    return ideal.order - max(same, outside if same else 0)


def summary(path: Path) -> str:
    """Counts and medians for each noise level and kind of plant."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    lines = []
    for snr in LEVELS:
        here = [row for row in rows if float(row["snr"]) == snr]
        lines.append(described(f"{snr:g} dB", here))
        for kind in ("inside", "outside"):
            for pole in ("False", "True"):
                part = [r for r in here if r["zeros"] == kind and r["integrator"] == pole]
                label = f"  zeros {kind}, integrator {'yes' if pole == 'True' else 'no'}"
                lines.append(described(label, part))
    wrong = [
        r["plant"]
        for r in rows
        if r["stable"] == "False" and "certified" in (r["small_gain"], r["characteristic"])
    ]
    return "\n".join([*lines, f"certified although unstable: {wrong or 'none'}"])


def described(label: str, rows: list[dict[str, str]]) -> str:
    """One line of the summary."""
    made = [r for r in rows if r["designed"] == "True"]
    stable = sum(r["stable"] == "True" for r in made)
    central = sum(r["centre"] == "True" for r in made)
    parts = [
        f"{label}: {len(rows)} plants, {len(made)} controllers ({central} central), {stable} stable"
    ]
    for method in ("small_gain", "characteristic"):
        count = {v: sum(r[method] == v for r in made) for v in ("certified", "refuted", "open")}
        seconds = [float(r[f"{method}_s"]) for r in made] or [0.0]
        parts.append(
            f"{method} certified {count['certified']}, refuted {count['refuted']}, open "
            f"{count['open']} ({np.median(seconds):.1f} s)"
        )
    return "; ".join(parts)


def begun(path: Path) -> set[int]:
    """Plants that a file holds at all noise levels; rows of others are taken out of it."""
    rows = []
    if path.exists():
        with path.open(newline="") as file:
            rows = [r for r in csv.DictReader(file) if None not in r.values() and None not in r]
    counts = Counter(row["plant"] for row in rows)
    whole = {plant for plant, count in counts.items() if count == len(LEVELS)}
    part = path.with_name(f"{path.name}.part")
    with part.open("w", newline="") as file:
        writer = csv.DictWriter(file, FIELDS)
        writer.writeheader()
        writer.writerows(row for row in rows if row["plant"] in whole)
    part.replace(path)
    return {int(plant) for plant in whole}


def main() -> None:
    """Run or summarise."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", type=int, default=12)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--output", type=Path, default=Path("control_study.csv"))
    parser.add_argument("--summary", type=Path, help="summarise a file instead")
    given = parser.parse_args()
    if given.summary is None:
        done = begun(given.output)
        with given.output.open("a", newline="") as file:
            writer = csv.DictWriter(file, FIELDS)
            for number in range(given.first, given.first + given.plants):
                if number not in done:
                    writer.writerows(cases(number))
                    file.flush()
    print(summary(given.summary or given.output))


if __name__ == "__main__":
    main()
