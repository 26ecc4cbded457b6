"""A measured record to the end: specification, reference model, controller, certificate, report.

The record is an open-loop experiment on a laboratory hair dryer (heater voltage to outlet
temperature). A PID controller is designed from it without a model of the plant. A certificate then
says whether the controller stabilises every plant of a stated structure that is consistent with
the record.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib.pyplot as plt

import setid
import sparsepop_py as sp
from setid import control

RECORD = Path(__file__).resolve().parent / "data" / "hairdryer.csv"
PLANT = setid.TransferFunction(na=1, nb=2, nk=3)  # one time constant, three samples of delay
# V. The plant's structure explains 200 samples with 0.252. A PID controller that is consistent with
# the reference model asks for more: 0.280 is the least that a local search over its three gains
# finds (a linear program in the noise for each).
BOUND = 0.295
# Steps are followed in 4 s with at most 10 % overshoot and no error in the end, disturbances up to
# 0.15 rad/s are halved, and at most 30 % of sensor noise above 6 rad/s reaches the output.
SPECIFICATION = control.Specification(
    Ts=0.08, type=1, rise=4.0, overshoot=0.1, disturbance=(0.15, 0.5), sensor_noise=(6.0, 0.3),
    delay=3,
)  # fmt: skip
# What reference_model_from makes of it, rounded, for machines without slycot
DESIGNED = control.Transfer(
    [0, 0, 0, 0.0586452, 0.0445841], [1, -0.8060457, 0.0008924, -0.051932, -0.0396854], 0.08
)


def reference_model() -> control.SpecifiedModel | None:
    """Reference model of the specification, where slycot is there."""
    try:
        found = control.reference_model_from(SPECIFICATION)
    except sp.SolverNotFound as missing:
        print(missing)
        print("the model that it gave elsewhere is used")
        return None
    for name, (asked, measured) in found.checks.items():
        print(f"  {name}: asked {asked:g}, has {measured:.3g}")
    return found


def main() -> None:
    """Design, certify, report."""
    plt.switch_backend("Agg")  # pictures go to files
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="for the page")
    output = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)
    data = setid.IOData.from_csv(RECORD, inputs="u", outputs="y", Ts=0.08).detrend()
    experiment, rest = data.split(200)

    specified = reference_model()
    reference = DESIGNED if specified is None else specified.model
    print("reference model", reference)
    options = setid.Options(cpu_limit=5.0, progress=False)
    simple = control.design(
        experiment, reference, control.PID(derivative=False), BOUND, options=options
    )
    print("PI controllers:", "none is consistent, proved" if simple.empty else simple.summary())
    found = control.design(experiment, reference, control.PID(filter=0.08), BOUND, options=options)
    print("PID controllers:")
    print(found.summary())

    answers = [
        control.stability_certificate(
            experiment, found.centre, reference, PLANT, BOUND, method=method, time_limit=10.0
        )
        for method in ("small_gain", "characteristic")
    ]
    for answer in answers:
        print(answer.summary())
    if answers[1]:
        margins = control.loop_margins(answers[1])
        low, high = margins.gain
        print(f"every consistent plant: abs(S) <= {margins.sensitivity:.3f}, proved;")
        print(f"gain margins {low:.3f} to {high:.3f}, phase margin {margins.phase:.3f} rad")
    page = output / "control_hairdryer.html"
    control.report(page, found, answers, specified)
    plt.close("all")
    print(f"report: {page}")
    least = setid.linf(rest, PLANT)
    print(
        f"""
What an engineer learns: the certificate holds for the structure and the noise bound that were
stated. They are assumptions, and more data can refute them. On the {rest.samples} samples that
were not used the equation needs an error of at least {least.cost:.3f} V, if errors are there."""
    )


if __name__ == "__main__":
    main()
