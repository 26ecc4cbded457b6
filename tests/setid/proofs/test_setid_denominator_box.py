"""Boxes from cones of denominators: by hand, in rationals, planted records, forged claims."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from scipy.optimize import linprog

import setid
from setid.feasible_set.start import find_box
from setid.minimum_noise.cones.feasible_box import denominator_box
from setid.proofs.denominators.cones import first_cones
from setid.proofs.denominators.denominator_box import (
    DenominatorBox,
    Limit,
    limit_holds,
    ratio_ends,
    upright,
)
from setid.proofs.denominators.denominator_cells import Cell, VaryingLeaf
from setid.proofs.denominators.output_rows import OutputRows, output_rows
from setid.proofs.denominators.varying_multipliers import VaryingCells, hurwitz_minors, pairs
from setid.proofs.parameter_box import box_follows, start_of
from setid.result.json_parts import read, write
from sparsepop_py.budget import Deadline

OPEN = VaryingLeaf((), (), ())

# ---- by hand ------------------------------------------------------------------------------


def integers(*rows) -> np.ndarray:
    return np.array(rows, object)


def test_ratios_are_rounded_outwards() -> None:
    low, high = ratio_ends(integers([3, 1, 6], [7, 2, 14], [1, 1, 1]))
    assert Fraction(low[0]) < Fraction(2, 7) < Fraction(low[0]) + Fraction(1, 2**50)
    assert (high[0], low[1], high[1]) == (1.0, 1.0, 2.0)
    low, high = ratio_ends(integers([-3, -1], [-1, 5]))
    assert low[0] == -5.0 and Fraction(high[0]) > Fraction(1, 3) > Fraction(high[0]) - 2**-50


@pytest.mark.parametrize("vector", [[0, 1], [-1, 1]])
def test_cones_without_monic_members_at_a_vector_bound_nothing(vector) -> None:
    cone = integers([1, 1], vector)
    assert upright(cone) is None
    assert [ends.tolist() for ends in ratio_ends(cone)] == [[-np.inf], [np.inf]]


GAIN = setid.IOData([1.0, 2.0], [0.5, 1.0])  # b in [.45, .55] where noise is at most .1
STATIC = setid.TransferFunction(na=0, nb=1)


def by_hand(limit: Limit, table=((0.0, -1.0), (0.0, 1.0))) -> tuple[float, float]:
    """The ends of the gain that a limit proves within [-9, 9]."""
    known = setid.formulate(GAIN, STATIC, setid.Noise(output=0.1))
    tree = VaryingCells(0, np.array([1]), np.array(table), (OPEN,))
    box = DenominatorBox(("b0",), np.zeros(1), np.zeros(1), None, (tree,), ((limit,),))
    found = box.hull(known, np.array([[-9.0], [9.0]]))
    assert found is not None
    return float(found[0][0]), float(found[1][0])


def test_a_gain_by_hand() -> None:
    """The second reading alone says 2 b - 1 = noise, at most .1 in size."""
    assert by_hand(Limit(0, 0, 1, 0.5501, (0,), (0,))) == (-9.0, 0.5501)
    assert by_hand(Limit(0, 0, -1, -0.4499, (1,), (0,))) == (0.4499, 9.0)
    for wrong in (
        Limit(0, 0, 1, 0.5499, (0,), (0,)),
        Limit(0, 0, -1, -0.4501, (1,), (0,)),
        Limit(0, 0, 1, 0.5501, (1,), (0,)),  # the other sign of the multiplier
        Limit(0, 0, 1, -100.0, (1,), (0,)),
        Limit(0, 0, 2, 0.5501, (0,), (0,)),
        Limit(0, 1, 1, 0.5501, (0,), (0,)),
        Limit(0, -1, 1, 0.5501, (0,), (0,)),
        Limit(1, 0, 1, 0.5501, (0,), (0,)),
        Limit(0, 0, 1, 0.5501, (0, 0), (0,)),
        Limit(0, 0, 1, 0.5501, (2,), (0,)),
        Limit(0, 0, 1, np.inf, (0,), (0,)),
        Limit(0, 0, 1, np.nan, (0,), (0,)),
        Limit(0, 0, 1, 0.5501, (0,), (0,), (1.0,)),
    ):
        assert by_hand(wrong) == (-9.0, 9.0)


def test_limits_of_a_cone_hold_on_its_halves() -> None:
    """And a part may have a nearer one of its own; the hull is that of both parts."""
    data = setid.IOData([1.0, 2.0, 4.0], [0.5, 1.0, 2.0])
    model = setid.TransferFunction(na=1, nb=1)
    known = setid.formulate(data, model, setid.Noise(output=0.1), [setid.Stable()])
    rows = output_rows(known, 0)
    assert rows is not None and rows.own == ("a1",) and rows.gains == (("b0", 1),)
    cells = (Cell((1, 2), (0, 1), (1, 1)), OPEN, OPEN)
    table = np.array([[0.0, 0.0, -1.0]])
    tree = VaryingCells(0, np.array([2]), table, cells)
    # 4 b = 2 + a + noise (1 + |a|) at most: .8 at a = 1, .525 at a = 0
    both = Limit(0, 0, 1, 0.81, (0, 0), (0, 0))
    near = Limit(1, 0, 1, 0.53, (0, 0), (0, 0))
    start = np.array([[-2.0, -9.0], [2.0, 9.0]])
    box = DenominatorBox(("a1", "b0"), np.zeros(2), np.zeros(2), None, (tree,), ((both,),))
    assert box.hull(known, start) is not None
    assert [end.tolist() for end in box.hull(known, start) or ()] == [[-1.0, -9.0], [1.0, 0.81]]
    one = first_cones(1, True)[0]
    assert limit_holds(rows, tree.free, table, one, both)
    assert not limit_holds(rows, tree.free, table, one, near)
    assert limit_holds(rows, tree.free, table, (tree.cones(rows) or {})[1], near)
    found = replace(box, limits=((both, near),)).hull(known, start)
    assert found is not None and found[1].tolist() == [1.0, 0.81]
    # a limit on a part alone says nothing of the other one
    found = replace(box, limits=((near,),)).hull(known, start)
    assert found is not None and found[1].tolist() == [1.0, 9.0]


def test_columns_of_no_parameter_alone_limit_nothing() -> None:
    """Two equal inputs have one column: its factor is the sum of their gains."""
    u = np.array([[1.0, 1.0], [2.0, 2.0]])
    model = setid.TransferFunction(na=0, nb=1, inputs=2)
    known = setid.formulate(setid.IOData(u, [0.5, 1.0]), model, setid.Noise(output=0.1))
    rows = output_rows(known, 0)
    assert rows is not None and rows.gains == (("", 1),)


# ---- in rationals ---------------------------------------------------------------------------


def least_end(rows: OutputRows, table, cone, limit: Limit) -> Fraction | None:
    """The least end of a gain that multipliers prove, from the definition."""
    n, count = rows.order, rows.y.size
    vectors = [
        [Fraction(int(v)) / 2 ** int(p) for v in line]
        for line, p in zip(cone, limit.powers, strict=True)
    ]
    y, w = ([Fraction(float(v)) for v in part] for part in (rows.y, rows.bound))
    lam = [[Fraction(float(v)) for v in table[m]] + [Fraction(0)] * n for m in limit.used]
    column = [Fraction(float(v)) for v in rows.known[:, limit.column]]
    share = [-limit.sign * sum(a * b for a, b in zip(one, column, strict=False)) for one in lam]
    if min(share) < 0:
        return None
    minors = hurwitz_minors(cone, limit.powers) if limit.minors else np.zeros((0, 10))
    found = []
    for place, (j, k) in enumerate(pairs(len(vectors))):
        need = give = Fraction(0)
        for s in range(count):
            both = sum(
                vectors[one][i] * lam[two][s + i]
                for one, two in ((j, k), (k, j))
                for i in range(n + 1)
            )
            need, give = need + both * y[s], give + abs(both) * w[s]
        for weight, line in zip(limit.minors, minors, strict=True):
            need -= Fraction(weight) * Fraction(float(line[place]))
        slope = vectors[j][0] * share[k] + vectors[k][0] * share[j]
        if slope <= 0:
            return None
        found.append((give - need) / slope)
    return max(found)


@pytest.mark.parametrize(("order", "stable"), [(1, False), (2, True), (3, True)])
def test_limits_hold_where_rationals_say(order: int, stable: bool) -> None:
    """A little above the least end they hold, a little below they do not."""
    random, seen = np.random.default_rng(order), 0
    for _ in range(60):
        count = 14
        y, bound = random.normal(size=count), random.uniform(0.5, 1.5, count)
        row = np.arange(count) >= order
        other = np.where(row & (np.arange(count) % 3 == 0), random.integers(1, 4, count), 0)
        own = np.where(row, random.integers(-3, 4, count), 0)
        rows = OutputRows(
            order,
            row,
            y,
            bound,
            np.column_stack([own, other]).astype(float),
            stable,
            own=("a",) * order,
            gains=(("b", 1), ("", 1)),
        )
        cone = first_cones(order, True)[0]
        cone = cone @ np.array(random.integers(1, 5, (order + 1, order + 1)).tolist(), object)
        cone[:, 0] = np.abs(cone[:, 0]) + 1
        sign = int(random.choice([-1, 1]))
        table = np.where(row & (other == 0), random.normal(size=(order + 1, count)), 0.0)
        towards = -sign * np.sign(table @ own)
        table *= np.where(towards == 0.0, 1.0, towards)[:, None]
        powers = tuple(random.integers(-1, 3, order + 1).tolist())
        minors = (0.001 * random.uniform(),) if order == 3 and random.integers(2) else ()
        limit = Limit(0, 0, sign, 0.0, tuple(range(order + 1)), powers, minors)
        end = least_end(rows, table, cone, limit)
        used = np.flatnonzero(own)
        if end is None or not used.size:
            continue
        free = np.array([used[other[used] == 0][0], np.flatnonzero(other)[0]])
        seen += 1
        gap = 1e-9 * max(1.0, abs(float(end)))
        for turned in (cone, -cone):
            for value, good in ((float(end) + gap, True), (float(end) - gap, False)):
                held = limit_holds(rows, free, table, turned, limit._replace(value=value))
                assert held is good
    assert seen > 20


# ---- planted records --------------------------------------------------------------------------

MODEL = setid.TransferFunction(na=2, nb=2, nk=1)
TRUTH = np.array([-1.2, 0.52, 0.8, -0.3])
SIZE = 0.05


def planted(samples: int = 60, seed: int = 0, priors=()) -> setid.Formulation:
    random = np.random.default_rng(seed)
    u = random.uniform(-1.0, 1.0, samples)
    y = setid.simulate(MODEL, TRUTH, u) + random.uniform(-SIZE, SIZE, samples)[:, None]
    return setid.formulate(setid.IOData(u, y), MODEL, setid.Noise(output=SIZE), priors)


def searched(known: setid.Formulation, tol: float = 0.5, width: float = 0.2) -> DenominatorBox:
    first = find_box(known)
    near = TRUTH - width / 10, TRUTH + width / 10
    found = denominator_box(known, first, near, tol, Deadline(60.0))
    assert isinstance(found, DenominatorBox)
    return found


@pytest.fixture(scope="module", params=[(), (setid.Stable(),)], ids=["any", "stable"])
def proved(request) -> tuple[setid.Formulation, DenominatorBox]:
    known = planted(priors=request.param)
    return known, searched(known)


Proved = tuple[setid.Formulation, DenominatorBox]


def gain_ends(known: setid.Formulation, a: np.ndarray) -> list[tuple[float, float]] | None:
    """The ends of both gains with a given denominator: programs in all noise and the gains."""
    data = known.data
    y, u, n, count = data.y[:, 0], data.u[:, 0], 2, data.samples
    rows, right = np.zeros((count - n, count + 2)), np.zeros(count - n)
    for row, k in enumerate(range(n, count)):
        rows[row, k - n : k + 1], rows[row, count:] = a[::-1], u[[k - 1, k - 2]]
        right[row] = a[::-1] @ y[k - n : k + 1]
    sizes = [(-SIZE, SIZE)] * count + [(None, None)] * 2
    found = []
    for place, sign in product((0, 1), (1.0, -1.0)):
        cost = np.zeros(count + 2)
        cost[count + place] = sign
        solved = linprog(cost, A_eq=rows, b_eq=right, bounds=sizes)
        if solved.status != 0:
            return None
        found.append(sign * solved.fun)
    return [(found[0], found[1]), (found[2], found[3])]


def test_consistent_parameters_lie_in_the_box(proved: Proved) -> None:
    """Programs with sampled denominators, around those of the truth."""
    known, box = proved
    assert np.all(box.lower <= TRUTH) and np.all(box.upper >= TRUTH)
    random, members = np.random.default_rng(1), 0
    for scale in np.repeat([0.001, 0.003, 0.01, 0.03], 12):
        a = np.append(1.0, TRUTH[:2] + scale * random.uniform(-1.0, 1.0, 2))
        ends = gain_ends(known, a)
        if ends is None:
            continue
        members += 1
        assert np.all(box.lower[:2] <= a[1:]) and np.all(a[1:] <= box.upper[:2])
        for place, (low, high) in enumerate(ends, 2):
            assert box.lower[place] <= low + 1e-9 and high - 1e-9 <= box.upper[place]
    assert members > 5


def test_the_box_is_near_and_follows(proved: Proved) -> None:
    known, box = proved
    first = find_box(known)
    assert first is not None and box.complete and not box.cut_short
    assert np.all(box.upper - box.lower < 0.7 * (first.upper - first.lower))
    assert box_follows(box, known)
    again = read(write(box))
    assert box_follows(again, known) and again.limits == box.limits


def test_less_is_refused(proved: Proved) -> None:
    """Each end a little nearer does not follow; nor does the box for more noise."""
    known, box = proved
    for place in range(4):
        for name, way in (("lower", 1.0), ("upper", -1.0)):
            ends = getattr(box, name).copy()
            ends[place] += way * 1e-9 * abs(ends[place])
            assert not box_follows(replace(box, **{name: ends}), known)
    more = setid.formulate(known.data, MODEL, setid.Noise(output=1.5 * SIZE), known.priors)
    assert not box_follows(box, more)


def test_forged_trees_are_refused(proved: Proved) -> None:
    known, box = proved
    tree, limits = box.trees[0], box.limits[0]
    at = next(n for n, c in enumerate(tree.cells) if isinstance(c, VaryingLeaf) and c.used)
    leaf, parted = tree.cells[at], next(c for c in tree.cells if isinstance(c, Cell))
    assert isinstance(leaf, VaryingLeaf)

    def with_cells(cells) -> DenominatorBox:
        return replace(box, trees=(replace(tree, cells=tuple(cells)),))

    for other in (OPEN, leaf._replace(shares=(-1.0,)), leaf._replace(used=((0,),))):
        changed = list(tree.cells)
        changed[at] = other
        found = with_cells(changed).hull(known, start_of(known))
        assert found is not None  # it stays, and may or may not widen the box
        assert np.all(found[0] <= box.lower) and np.all(found[1] >= box.upper)
    place = tree.cells.index(parted)
    for wrong in (
        parted._replace(children=(parted.children[0],) * 2),
        parted._replace(children=(place, parted.children[1])),
        parted._replace(children=(len(tree.cells), parted.children[1])),
        parted._replace(weights=(0, 1)),
        parted._replace(edge=(1, 1)),
    ):
        changed = list(tree.cells)
        changed[place] = wrong
        assert with_cells(changed).hull(known, start_of(known)) is None
        assert not box_follows(with_cells(changed), known)
    assert not box_follows(replace(box, trees=(), limits=()), known)
    assert not box_follows(replace(box, limits=()), known)
    assert not box_follows(replace(box, limits=((),)), known)
    assert not box_follows(replace(box, trees=(replace(tree, output=1),)), known)
    assert not box_follows(replace(box, trees=(replace(tree, output=-1),)), known)
    assert not box_follows(replace(box, trees=(replace(tree, free=tree.free[:-1]),)), known)
    lower = tuple(limit._replace(value=limit.value - 0.05) for limit in limits)
    assert not box_follows(replace(box, limits=(lower,)), known)
    table = tree.multipliers * (1.0 + 1e-3 * np.sin(np.arange(tree.multipliers.shape[1])))
    assert not box_follows(replace(box, trees=(replace(tree, multipliers=table),)), known)


def test_the_first_box_has_to_follow(proved: Proved) -> None:
    known, box = proved
    assert box.first is not None
    narrow = replace(box.first, lower=box.first.lower + 0.1)
    assert not box_follows(replace(box, first=narrow), known)


def test_a_record_that_nothing_explains_has_an_empty_box() -> None:
    """Half the noise that was put in, where a third is needed at least somewhere."""
    known = planted()
    less = setid.formulate(known.data, MODEL, setid.Noise(output=0.5 * SIZE))
    found = denominator_box(less, None, (TRUTH - 0.01, TRUTH + 0.01), 0.5, Deadline(60.0))
    assert found is not None and found.empty and box_follows(found, less)
    assert not box_follows(found, known)


def test_minors_of_limits_need_the_prior() -> None:
    """Without it nobody says that they are >= 0."""
    random, count = np.random.default_rng(0), 12
    row = np.arange(count) >= 3
    own = np.where(row, 1.0, 0.0)[:, None]
    rows = OutputRows(
        3,
        row,
        random.normal(size=count),
        np.full(count, 0.1),
        own,
        True,
        own=("a",) * 3,
        gains=(("b", 1),),
    )
    table = np.tile(np.where(row, -random.uniform(0.5, 1.0, count), 0.0), (4, 1))
    cone = first_cones(3, True)[0]
    limit = Limit(0, 0, 1, 1e3, (0, 1, 2, 3), (0,) * 4, (1e-9,))
    assert limit_holds(rows, np.array([5]), table, cone, limit)
    assert not limit_holds(rows._replace(stable=False), np.array([5]), table, cone, limit)
    assert not limit_holds(rows, np.array([5]), table, cone, limit._replace(minors=(-1e-9,)))
