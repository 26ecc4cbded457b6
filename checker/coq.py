"""Certificates as Coq files: ``python checker/coq.py problem.json certificate.json proof.v``.

The file states the problem in rationals and proves ``forall x, constraints -> bound <= f x`` with
the standard library alone: ``coqc proof.v``. It covers trees whose ends are identities of squares,
linear duals or empty boxes, over boxes that follow from the rows one at a time: steps are not
replayed. Matrices, priced monomials, exact Gram matrices, exact duals and variables without a box
are not covered.

All is computed in integers, for X = 2^m x. Boxes shrink by "shaving": a row is negative all over
the part of the box beyond the new end. Since points above the claim need no proof, the row
claim - f >= 0 helps with it.
"""

from __future__ import annotations

import re
import sys
from fractions import Fraction
from math import gcd, lcm
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from checker.arithmetic import interval as iv
from checker.arithmetic.polynomial import INF, Polynomial, Word, dyadic, powers
from checker.certificates.certificate import Certificates, Part
from checker.certificates.identity import Group, Identity, LinearDual
from checker.certificates.propagation import Box, Row, Rows
from checker.command import UNEXPECTED, problem_of
from checker.files import reading
from checker.files.reading import Malformed, Problem, below

Ends = list[tuple[int | None, int | None]]  # of X; None is infinite
ROUNDS = 60  # sweeps over all rows at a node
GAIN, LEAST_GAIN = 20, 30_000  # a shave gains a 20th of a width; where more is asked, a 30 000th


class NotCovered(Exception):
    """The certificate uses something that this export has no Coq proof for."""


class Term(NamedTuple):
    """A coefficient times powers (a X_v + b)^n: tuples a, b, v, n."""

    coefficient: int
    factors: tuple[tuple[int, int, int, int], ...]


class Form(NamedTuple):
    """A positive multiple of a row as a sum of terms, in which ranges are narrow."""

    multiple: int
    terms: list[Term]
    equality: bool


def restated(p: Polynomial, m: int, least: int = 0) -> tuple[dict[Word, int], int]:
    """Scale p to integers: G(X) = 2^E p(x) for X = 2^m x, E >= least."""
    degree = max(map(len, p.terms), default=0)
    shift = max(least - m * degree + p.exp, 0)
    found = {w: c << (m * (degree - len(w)) + shift) for w, c in p.terms.items() if c}
    return found, m * degree - p.exp + shift


def form_of(terms: dict[Word, int], equality: bool, complete: bool = True) -> Form:
    """Write a row as a form, squares c1 X + c2 X^2 completed if asked."""
    left, multiple = dict(terms), 1
    pairs: list[tuple[int, int, int]] = []
    both = [w for w in terms if len(w) == 2 and w[0] == w[1] and (w[0],) in terms]
    for square in both if complete else []:
        pairs.append((square[0], left.pop((square[0],)), left.pop(square)))
        multiple = lcm(multiple, 4 * abs(pairs[-1][2]))
    constant = left.pop((), 0) * multiple
    found = []
    for v, c1, c2 in pairs:  # 4 c2 (c1 X + c2 X^2) = (2 c2 X + c1)^2 - c1^2
        share = multiple // (4 * c2)
        common = gcd(2 * c2, c1)
        found.append(Term(share * common**2, ((2 * c2 // common, c1 // common, v, 2),)))
        constant -= share * c1 * c1
    for word, value in left.items():
        factors = tuple((1, 0, v + 1, n) for v, n in powers(word))
        found.append(Term(value * multiple, factors))
    first = [Term(constant, ())] if constant else []
    return Form(multiple, first + found, equality)


# ---- intervals as in the kernel ------------------------------------------------------------------


def i_scale(k: int, b: int, i: Any) -> Any:
    """Compute the interval k x + b."""
    ends = [None if e is None else k * e + b for e in i]
    return tuple(ends if k >= 0 else ends[::-1])


def i_mul(i: Any, j: Any) -> Any:
    """Multiply as the kernel does."""
    (a, b), (c, d) = i, j
    if None not in (a, b, c, d):
        four = (a * c, a * d, b * c, b * d)
        return min(four), max(four)
    if a is not None and c is not None and a >= 0 and c >= 0:
        return a * c, (None if b is None or d is None else b * d)
    return None, None


def i_power(i: Any, n: int) -> Any:
    """Compute the power, as the kernel encloses it."""
    if n % 2 == 0:
        a, b = i
        if b is not None and b <= 0:
            i = i_scale(-1, 0, i)
        elif a is None or a < 0:
            i = (0, None if a is None or b is None else max(-a, b))
    found = i
    for _ in range(n - 1):
        found = i_mul(i, found)
    return found


def range_of(form: Form, box: Ends) -> tuple[Any, Any]:
    """Enclose a form over a box, as the kernel does."""
    low: Any = 0
    high: Any = 0
    for term in form.terms:
        part: Any = None
        for a, b, v, n in reversed(term.factors):
            power = i_power(i_scale(a, b, box[v - 1]), n)
            part = power if part is None else i_mul(power, part)
        part = i_scale(term.coefficient, 0, (1, 1) if part is None else part)
        low = None if low is None or part[0] is None else low + part[0]
        high = None if high is None or part[1] is None else high + part[1]
    return low, high


def never(form: Form, box: Ends) -> bool:
    """Check whether a row cannot hold on a box, as the kernel finds it."""
    low, high = range_of(form, box)
    return bool((high is not None and high < 0) or (form.equality and low is not None and low > 0))


# ---- shaving ------------------------------------------------------------------------------------


class Shaver:
    """Rows of a problem in X, the last of them claim - f >= 0."""

    def __init__(self, rows: list[dict[Word, int]], equal: list[bool], m: int) -> None:
        self.forms = [form_of(row, e) for row, e in zip(rows, equal, strict=True)]
        targets = [(0, 0) if e else (0, INF) for e in equal]
        pairs = zip(rows, targets, strict=True)
        self.rows = [Row(Polynomial(dict(row)), target) for row, target in pairs]
        self.unit = 1 << m

    def shrink(self, box: Ends, goal: list[tuple[Fraction, Fraction]] | None) -> list[str]:
        """Shrink a box in place, into the goal if there is one; the shaves that do it."""
        found: list[str] = []
        self.share = GAIN
        for _ in range(ROUNDS):
            before = len(found)
            for number in range(len(self.rows)):
                found += self._by_row(number, box)
                if _empty(box):
                    return found
            if goal is not None and lies_in(box, goal):
                break
            if len(found) == before:
                if goal is None or self.share == LEAST_GAIN:
                    break
                self.share = LEAST_GAIN
        return found

    def _by_row(self, number: int, box: Ends) -> list[str]:
        one = iv.scaled(1, 0)[0]
        ends = [(-INF if a is None else a * one, INF if b is None else b * one) for a, b in box]
        inside = Box(list(ends))
        Rows([self.rows[number]], []).sweep(inside, False)
        if inside.empty:
            return self._emptied(number, box)
        found = []
        for v in sorted(self.rows[number].variables):
            for upper in (True, False):
                new = inside.ends[v][upper]
                if new not in (INF, -INF):
                    found += self._cut(
                        number, box, v, upper, -(-new // one) if upper else new // one
                    )
        return found

    def _cut(self, number: int, box: Ends, v: int, upper: bool, end: int) -> list[str]:
        """Move one end to the new one, or a little less far."""
        old = box[v][1 if upper else 0]
        sign = 1 if upper else -1
        for slack in (60, 40, 30, 20, 10):  # of the size, in bits
            size = max(abs(end), self.unit)
            new = end + sign * (1 + (size >> slack))
            if old is not None and not self._gains(box[v], old, new, sign):
                return []
            if self._holds(number, box, v, upper, new):
                low, high = box[v]
                box[v] = (low, new) if upper else (new, high)
                return [self._text(number, v, upper, new)]
        return []

    def _gains(self, pair: Any, old: int, new: int, sign: int) -> bool:
        other = pair[0] if sign > 0 else pair[1]
        gain = sign * (old - new)
        if other is None:
            return bool(gain > 0.1 * (self.unit + abs(old)))
        return bool(gain * self.share > abs(old - other))

    def _holds(self, number: int, box: Ends, v: int, upper: bool, end: int) -> bool:
        far = list(box)
        low, high = box[v]
        if upper:
            far[v] = (end if low is None else max(low, end), high)
        else:
            far[v] = (low, end if high is None else min(high, end))
        return never(self.forms[number], far)

    def _emptied(self, number: int, box: Ends) -> list[str]:
        """A shave beyond the other end, where the row fails all over the box."""
        if never(self.forms[number], box):
            for v, (low, high) in enumerate(box):
                if low is not None and high is not None:
                    box[v] = (low, low - 1)
                    return [self._text(number, v, True, low - 1)]
        return []

    def _text(self, number: int, v: int, upper: bool, end: int) -> str:
        side = "true" if upper else "false"
        return (
            f"shave_by {number}%nat multiple{number} form{number} {v + 1}%positive {side} ({end})"
        )


def lies_in(box: Ends, goal: list[tuple[Fraction, Fraction]]) -> bool:
    """Check whether a box lies in another one, that is finite."""
    pairs = zip(box, goal, strict=True)
    return all(
        a is not None and b is not None and low <= a and b <= high for (a, b), (low, high) in pairs
    )


def _empty(box: Ends) -> int:
    """The variable, from 1, whose ends are crossed; 0 if there is none."""
    for v, (low, high) in enumerate(box, 1):
        if low is not None and high is not None and low > high:
            return v
    return 0


# ---- identities ---------------------------------------------------------------------------------


class Weighted(NamedTuple):
    """2^exp times: an integer times p^2 times a generator, or p times an equation."""

    exp: int
    kind: str  # "Square" or "Free"
    weight: int
    polynomial: dict[Word, int]
    generator: str


class Exporter:
    """A problem and what its certificate's parts become."""

    def __init__(self, problem: Problem, certificates: Certificates, m: int) -> None:
        self.problem, self.m = problem, m
        self.certificate = certificates.list[-1]
        if self.certificate.claim in (INF, -INF) and self.certificate.claim < 0:
            raise NotCovered("the certificate claims nothing")
        self.empty = self.certificate.claim == INF
        self.claim = Fraction(0 if self.empty else self.certificate.claim)
        least = self.claim.denominator.bit_length() - 1
        self.objective, self.power = restated(problem.objective, m, least)
        self.bound = int(self.claim * 2**self.power)
        self.rows, self.powers = [], []
        for c in problem.constraints:
            if c.side:
                raise NotCovered("matrices")
            row, power = restated(c.polynomial, m)
            self.rows.append(row)
            self.powers.append(power)
        last = {w: -c for w, c in self.objective.items()}
        last[()] = last.get((), 0) + self.bound
        equal = [c.equality for c in problem.constraints]
        own = [] if self.empty else [last]
        self.shaver = Shaver(self.rows + own, equal + [False] * len(own), m)

    def tree(self, part: Part, box: Ends) -> str:
        """Write the Coq term of a part and all parts below."""
        shaves = self.shaver.shrink(box, self._goal(part))
        steps = "[" + ";\n    ".join(shaves) + "]"
        if v := _empty(box):
            return f"(Void {steps} {v}%positive)"
        if part.branch is not None:
            v, place = part.branch
            at = int(place * 2**self.m)
            low, high = list(box), list(box)
            left, right = box[v]
            low[v] = (left, at if right is None else min(right, at))
            high[v] = (at if left is None else max(left, at), right)
            pair = [self.certificate.parts[child] for child in part.children]
            parts = [self.tree(child, half) for child, half in zip(pair, (low, high), strict=True)]
            return f"(Branch {steps} {v + 1}%positive ({at})\n  {parts[0]}\n  {parts[1]})"
        if part.argument is None and not self.empty:
            return f"(Plain {steps}\n  {self._plain(box)})"
        return f"(Leaf {steps}\n  {self.identity(part, box)})"

    def _plain(self, box: Ends) -> str:
        """A form of the objective whose range over the box is enough."""
        for form in (form_of(self.objective, False), form_of(self.objective, False, False)):
            low, _ = range_of(form, box)
            if low is not None and low >= form.multiple * self.bound:
                return f"{form_text(form)} {form.multiple}"
        raise NotCovered("a part that rests on the squares of the objective, or on its box alone")

    def _goal(self, part: Part) -> list[tuple[Fraction, Fraction]] | None:
        """The box of X that the multipliers of a part are about."""
        scaling = getattr(part.argument, "scaling", None)
        if scaling is None or part.branch is not None or not all(scaling.boxed):
            return None
        pairs = zip(scaling.centre, scaling.scale, strict=True)
        ends = [(Fraction(c) * 2**self.m, Fraction(s) * 2**self.m) for c, s in pairs]
        return [(c - s, c + s) for c, s in ends]

    def identity(self, part: Part, box: Ends) -> str:
        """Scale the identity of a part to integers."""
        argument = part.argument
        if not isinstance(argument, (Identity, LinearDual)):
            raise NotCovered(f"a part without multipliers ({type(argument).__name__})")
        scaling = argument.scaling
        pairs = []
        for v in range(self.problem.dimension):
            c, s = (Fraction(x[v]) * 2**self.m for x in (scaling.centre, scaling.scale))
            plain = (scaling.low[v], scaling.high[v]) == ((-1.0, 1.0) if s else (0.0, 0.0))
            if not scaling.boxed[v] or not plain:
                raise NotCovered("variables without a box, or with other ends of t")
            if not lies_in(box[v : v + 1], [(c - s, c + s)]):
                raise NotCovered("a box that does not follow from the rows one at a time")
            pairs.append(f"({v + 1}%positive, ({int(c)}, {int(s)})%Z)")
        if isinstance(argument, Identity):
            found = [w for group in argument.groups for w in self._group(group, argument)]
            if argument.priced.terms:
                raise NotCovered("priced monomials")
        else:
            found = self._linear(argument)
        scale = max([self.power, *(-w.exp for w in found)])
        texts = []
        for w in found:
            factor = 1 << (w.exp + scale)
            if w.kind == "Square":
                polynomial = poly_text(w.polynomial)
                texts.append(f"Square ({w.weight * factor}) {polynomial} {w.generator}")
            else:
                scaled = {word: value * factor for word, value in w.polynomial.items()}
                texts.append(f"Free {poly_text(scaled)} {w.generator}")
        multiple = 0 if part.empty else 1 << (scale - self.power)
        listed = ";\n    ".join(texts)
        return (
            f"{{| icentre := [{'; '.join(pairs)}];\n   ifactor := {multiple};\n"
            f"   imults := [{listed}] |}}"
        )

    def _generator(self, k: int, argument: Any) -> tuple[str, int] | None:
        """A generator as a Coq term and its power of two; None where it is zero."""
        count, n = len(self.rows), self.problem.dimension
        given = argument if isinstance(argument, Identity) else argument.given
        products = given.products
        below([k], count + 1 + 3 * n + len(products), "a generator")
        if k == 0:
            return "One", 0
        if k <= count:
            return f"(Row {k - 1}%nat)", self.powers[k - 1]
        if k > count + 3 * n:
            pair = [self._generator(j, argument) for j in products[k - 1 - count - 3 * n]]
            if pair[0] is None or pair[1] is None:
                return None
            return f"(Times {pair[0][0]} {pair[1][0]})", pair[0][1] + pair[1][1]
        family, v = divmod(k - 1 - count, n)
        if argument.scaling.scale[v] == 0:
            return None
        return f"({('Both', 'Low', 'High')[family]} {v + 1}%positive)", 0

    def _group(self, group: Group, argument: Identity) -> list[Weighted]:
        found = []
        if group.place is not None:
            raise NotCovered("matrices")
        for k, number in enumerate(group.generator):
            made = self._generator(number, argument)
            if made is None:
                continue
            name, power = made
            basis = group.basis[k]
            if group.free:
                values, exp = dyadic(group.values[k])
                found.append(self._free(dict_of(basis, values), exp, number))
                continue
            flat, exp = dyadic([v for row in group.values[k] for v in row])
            width = len(flat) // len(basis)
            for r in range(width):
                column = dict_of(basis, flat[r::width])
                if column:
                    found.append(Weighted(2 * exp - power, "Square", 1, column, name))
            (floor,), exp = dyadic([group.floor])
            for word in basis if floor else ():
                found.append(Weighted(exp - power, "Square", floor, {word: 1}, name))
        return found

    def _free(self, polynomial: dict[Word, int], exp: int, number: int) -> Weighted:
        return Weighted(exp - self.powers[number - 1], "Free", 1, polynomial, f"{number - 1}%nat")

    def _linear(self, argument: LinearDual) -> list[Weighted]:
        got, found = argument.given, []
        for k, word, value, _ in zip(got.generator, got.word, got.value, got.owner, strict=True):
            (whole,), exp = dyadic([value])
            made = self._generator(k, argument)
            equal = 1 <= k <= len(self.rows) and self.problem.constraints[k - 1].equality
            if equal and whole:
                found.append(self._free({word: whole}, exp, k))
            elif made is not None and whole > 0:
                found.append(Weighted(exp - made[1], "Square", whole, {(): 1}, made[0]))
        return found


def dict_of(words: list[Word], values: list[int]) -> dict[Word, int]:
    """Collect a polynomial from words that may repeat."""
    found: dict[Word, int] = {}
    for word, value in zip(words, values, strict=True):
        found[word] = found.get(word, 0) + value
    return {word: value for word, value in found.items() if value}


# ---- the text -----------------------------------------------------------------------------------


def poly_text(terms: dict[Word, int]) -> str:
    """Write a polynomial of the kernel, its words in order."""
    listed = sorted(terms.items(), key=lambda term: (len(term[0]), term[0]))
    words = {w: f"[{'; '.join(map(str, w))}]%positive" if w else "[]" for w, _ in listed}
    return f"[{'; '.join(f'({words[w]}, ({c})%Z)' for w, c in listed if c)}]"


def form_text(form: Form) -> str:
    """Write a form of the kernel."""
    parts = []
    for term in form.terms:
        factors = "; ".join(f"({a}, {b}, {v}%positive, {n}%nat)" for a, b, v, n in term.factors)
        parts.append(f"({term.coefficient}, [{factors}])")
    return f"[{'; '.join(parts)}]%Z"


def real(value: Fraction) -> str:
    """Write a rational number in R."""
    sign = "-" if value < 0 else ""
    text = f"{sign}{abs(value.numerator)}"
    return text if value.denominator == 1 else f"({text} / {value.denominator})"


def readable(p: Polynomial, names: list[str]) -> str:
    """Write a polynomial in R, for people."""
    parts = []
    for word, value in sorted(p.coefficients().items(), key=lambda term: (len(term[0]), term[0])):
        if not value:
            continue
        factors = [names[v] + (f" ^ {n}" if n > 1 else "") for v, n in powers(word)]
        if value != 1 or not factors:
            factors.insert(0, real(value) if value > 0 else f"({real(value)})")
        parts.append(" * ".join(factors))
    return " + ".join(parts) or "0"


def remarks(problem: Problem) -> str:
    """Tell as comments which variable of the problem is which of the theorem, and its sense.

    Names that could end a comment are left out.
    """
    pairs = [(f"x{v}", name) for v, name in enumerate(problem.names, 1)]
    plain = [
        (x, name) for x, name in pairs if x != name and re.fullmatch(r"[\w.,\[\]]+", name, re.A)
    ]
    lines = [f"(* {x} is {name} of the problem *)" for x, name in plain]
    if problem.sense == "max":
        lines.append("(* the objective is the negative of what is maximised *)")
    return "".join(f"{line}\n" for line in lines)


def statement(problem: Problem, claim: Fraction | None) -> tuple[str, int]:
    """Write the theorem in words that people read; count its hypotheses."""
    names = [f"x{v + 1}" for v in range(problem.dimension)]
    lines = []
    for name, low, high in zip(names, problem.lower, problem.upper, strict=True):
        lines += [f"{real(low)} <= {name}"] if low != -INF else []
        lines += [f"{name} <= {real(high)}"] if high != INF else []
    for c in problem.constraints:
        relation = f"{readable(c.polynomial, names)} = 0"
        lines.append(relation if c.equality else f"0 <= {readable(c.polynomial, names)}")
    goal = "False" if claim is None else f"{real(claim)} <= {readable(problem.objective, names)}"
    lines = [f"  {line} ->" for line in lines]
    return f"forall {' '.join(names)} : R,\n" + "\n".join([*lines, f"  {goal}"]), len(lines)


PROOF = Template("""$kernel
(* ---- the problem and its proof ---- *)

Definition shave_by k m f v u e :=
  {| srow := k; smul := m; sform := f; svar := v; supper := u; send := e |}.

Definition rows : list row := [$rows].
Definition objective : poly := $objective.
Definition bound : Z := $bound.
Definition first_box : box := $first.
Open Scope Z_scope.
Open Scope positive_scope.
Open Scope Z_scope.
$forms
Definition proof : tree := $tree.
Open Scope R_scope.

Lemma checked :
  $check = true.
Proof. vm_cast_no_check (eq_refl true). Qed.

${remarks}Theorem proved : $goal.
Proof.
  intros $names $hypotheses.
  pose (X := fun v : positive => match v with $cases | _ => 0 end).
  assert (Hrows : all_hold X rows).
  { intros r Hr. cbv delta [rows] in Hr. simpl In in Hr.
    repeat (destruct Hr as [<-|Hr]; [cbv beta iota delta [holds snd fst ev mon X]; lra | ]).
    destruct Hr. }
  assert (Hbox : inside X first_box).
  { unfold first_box. repeat (apply inside_add; [|
      cbv beta iota delta [mem above below snd fst X]; split; try exact I; lra]).
    apply inside_empty. }
  assert (H : IZR bound <= ev X objective).
  { $sound }
  cbv beta iota delta [bound objective ev mon X] in H. lra.
Qed.

Print Assumptions proved.
""")
CHECKS = {
    False: "check (rows ++ [(padd (pconst bound) (pmono [] (-1) objective), false)]) "
    "objective bound first_box proof",
    True: "check rows objective bound first_box proof",
}
SOUND = {
    False: "exact (sound rows objective bound bound first_box proof X Hrows Hbox "
    "(Z.leb_refl bound) checked).",
    True: "exact (check_sound rows objective bound proof X Hrows first_box Hbox checked).",
}


def coq(problem: Problem, certificates: Certificates) -> str:
    """Write the Coq file that proves the last certificate's claim about the problem."""
    m = exponent(problem, certificates)
    made = Exporter(problem, certificates, m)
    unit = 2**m
    box: Ends = [
        (None if a == -INF else int(a * unit), None if b == INF else int(b * unit))
        for a, b in zip(problem.lower, problem.upper, strict=True)
    ]
    tree = made.tree(certificates.list[-1].parts[0], list(box))
    goal, count = statement(problem, None if made.empty else made.claim)
    rows = "; ".join(
        f"({poly_text(row)}, {'true' if c.equality else 'false'})"
        for row, c in zip(made.rows, problem.constraints, strict=True)
    )
    forms = "".join(
        f"Definition multiple{k} : Z := {form.multiple}.\n"
        f"Definition form{k} : form := {form_text(form)}.\n"
        for k, form in enumerate(made.shaver.forms)
    )
    letters = range(1, problem.dimension + 1)
    return PROOF.substitute(
        kernel=(Path(__file__).resolve().parent / "kernel.v").read_text(encoding="utf-8"),
        rows=rows,
        objective=poly_text({} if made.empty else made.objective),
        bound=1 if made.empty else made.bound,
        first=box_text(box),
        forms=forms,
        tree=tree,
        check=CHECKS[made.empty],
        remarks=remarks(problem),
        goal=goal,
        names=" ".join(f"x{v}" for v in letters),
        hypotheses=" ".join(f"H{k}" for k in range(count)),
        cases=" ".join(f"| {v}%positive => {unit} * x{v}" for v in letters),
        sound=SOUND[made.empty],
    )


def box_text(box: Ends) -> str:
    """Write a box of the kernel."""
    found = "(M.empty ivl)"
    for v, ends in reversed(list(enumerate(box, 1))):
        low, high = ("None" if end is None else f"Some ({end})%Z" for end in ends)
        found = f"(M.add {v}%positive ({low}, {high}) {found})"
    return found


def exponent(problem: Problem, certificates: Certificates) -> int:
    """Find the least m >= 64 with all places of boxes multiples of 2^-m."""
    bits = [64]
    for end in (*problem.lower, *problem.upper):
        bits.append(0 if end in (INF, -INF) else end.denominator.bit_length() - 1)
    for part in certificates.list[-1].parts:
        bits.append(0 if part.branch is None else part.branch[1].denominator.bit_length() - 1)
        scaling = getattr(part.argument, "scaling", None)
        for values in () if scaling is None else (scaling.centre, scaling.scale):
            bits.append(-dyadic(values)[1])
    return max(bits)


def main(arguments: list[str]) -> int:
    """Write the Coq file of a certificate; 1 where it is not covered, 2 where it is not written."""
    if len(arguments) != 3:
        sys.stderr.write("python checker/coq.py problem.json certificate.json proof.v\n")
        return 2
    try:
        problem, _ = problem_of(arguments[0])
        name, found = reading.content(reading.load(arguments[1]), arguments[1])
        found = reading.item(found, "certificate", name) if name == "result" else found
        text = coq(problem, Certificates(found, problem))
    except (NotCovered, Malformed) as error:
        sys.stdout.write(f"{type(error).__name__}: {error}\n")
        return 1
    except UNEXPECTED as error:
        sys.stdout.write(f"Malformed: something that nobody expected: {error!r:.200}\n")
        return 1
    try:
        Path(arguments[2]).write_text(text, encoding="utf-8")
    except OSError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
