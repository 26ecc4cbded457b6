"""What all adapters share: read a task, answer each objective, one JSON line each.

An adapter is a script for the interpreter of one peer, ``python NAME.py TASK ANSWERS``. It
imports nothing of this project. The task holds ``n``, ``lower``, ``upper``, ``rows`` (``equal``
and ``terms``), ``objectives`` (terms), ``gaps``, ``relative``, ``seconds``, ``order`` and for
conic solvers ``programs``; terms are pairs of a coefficient and a list of variables from 0, and a
row says that its polynomial is >= 0, or == 0 where it is ``equal``.
"""

import json
import math
import sys
import time

INF = math.inf


class Refused(Exception):
    """The peer does not take such a problem; the message says why."""


def answer(status, lower=-INF, upper=INF, x=None, begin=None, middle=None):
    """One answer; CPU seconds of modelling and solving from process_time at begin and middle."""
    now = time.process_time()
    begin, middle = now if begin is None else begin, now if middle is None else middle
    found = None if x is None else [float(v) for v in x]
    return {
        "status": str(status),
        "lower": float(lower),
        "upper": float(upper),
        "x": found,
        "modelling": middle - begin,
        "solving": now - middle,
    }


def run(solve):
    """Answer all objectives of the task; a failure ends them."""
    with open(sys.argv[1], encoding="utf-8") as file:
        task = json.load(file)
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        for number in range(len(task["objectives"])):
            try:
                found = solve(task, number)
            except Refused as error:
                found = answer(f"refused: {error}")
            except Exception as error:
                words = " ".join(str(error).split())[:200]
                found = answer(f"error: {type(error).__name__}: {words}")
            print(json.dumps(found), file=file, flush=True)
            if found["status"].startswith(("refused", "error")):
                break


def value(terms, x, zero=0.0):
    """The polynomial at x, which may be numbers or expressions of a modelling language."""
    total = zero
    for coefficient, letters in terms:
        term = coefficient
        for v in letters:
            term = term * x[v]
        total = total + term
    return total


def degree(terms):
    """The degree of a polynomial."""
    return max((len(letters) for _, letters in terms), default=0)


def by_powers(terms, n):
    """The polynomial as {exponents: coefficient}."""
    found = {}
    for coefficient, letters in terms:
        key = tuple(letters.count(v) for v in range(n))
        found[key] = found.get(key, 0.0) + coefficient
    return found


def bounds_as_rows(task):
    """Finite bounds as terms that are >= 0."""
    rows = []
    for v, (low, high) in enumerate(zip(task["lower"], task["upper"], strict=True)):
        if math.isfinite(low):
            rows.append([[1.0, [v]], [-low, []]])
        if math.isfinite(high):
            rows.append([[high, []], [-1.0, [v]]])
    return rows


class Quadratic:
    """A polynomial problem with variables for products, so that all terms have degree two.

    ``add_variable(low, high)`` and ``add_product(w, u, v)``, which says w == u v, belong to the
    peer.
    """

    def __init__(self, task, add_variable, add_product):
        self.low, self.high = list(task["lower"]), list(task["upper"])
        self.add_variable, self.add_product = add_variable, add_product
        self.x = [add_variable(low, high) for low, high in zip(self.low, self.high, strict=True)]
        self.known = {}

    def value(self, terms, zero=0.0):
        """The polynomial in the peer's variables."""
        return value([(c, self._pair(sorted(letters))) for c, letters in terms], self.x, zero)

    def _pair(self, letters):
        while len(letters) > 2:
            letters = sorted([self._product(letters[0], letters[1]), *letters[2:]])
        return letters

    def _product(self, u, v):
        if (u, v) not in self.known:
            ends = [a * b if a and b else 0.0 for a in (self.low[u], self.high[u])
                    for b in (self.low[v], self.high[v])]  # fmt: skip
            low, high = min(ends), max(ends)
            low = max(low, 0.0) if u == v else low
            self.low.append(low)
            self.high.append(high)
            self.x.append(self.add_variable(low, high))
            self.add_product(self.x[-1], self.x[u], self.x[v])
            self.known[u, v] = len(self.x) - 1
        return self.known[u, v]
