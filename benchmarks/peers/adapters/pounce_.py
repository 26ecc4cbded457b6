"""pounce-solver: sums of squares with a flag that says what is certified."""

import time

from common import answer, bounds_as_rows, by_powers, run
from pounce import sos_minimize


def solve(task, number):
    begin = time.process_time()
    n = task["n"]
    above = [row["terms"] for row in task["rows"] if not row["equal"]] + bounds_as_rows(task)
    equal = [row["terms"] for row in task["rows"] if row["equal"]]
    objective = by_powers(task["objectives"][number], n)
    middle = time.process_time()
    found = sos_minimize(
        objective,
        inequalities=[by_powers(terms, n) for terms in above],
        equalities=[by_powers(terms, n) for terms in equal],
        n_vars=n,
        order=task["order"],
    )
    status = "certified" if found.certified else "not certified"
    points = getattr(found, "minimizers", None)
    x = list(points[0]) if points is not None and len(points) else None
    upper = float("inf") if x is None else _value(objective, x)
    return answer(status, found.lower_bound, upper, x, begin, middle)


def _value(polynomial, x):
    total = 0.0
    for powers, coefficient in polynomial.items():
        term = coefficient
        for v, power in zip(x, powers, strict=True):
            term *= v**power
        total += term
    return total


run(solve)
