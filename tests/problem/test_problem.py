"""Problems: what is stored, what is refused and with which words, and the fingerprint."""

import copy
import pickle
import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

import sparsepop_py as sp
from sparsepop_py import Constraint, Kind, Problem, ProblemError


def pair():
    return sp.variables(2, ["x", "y"])


# ---- violation ---------------------------------------------------------------------------


@given(st.tuples(*[st.integers(-40, 40)] * 2))
@settings(deadline=None)
def test_violation_is_the_worst_of_rows_and_bounds(numerators):
    """All values are multiples of 1/64 below 2^10, so floating point is exact here."""
    x, y = pair()
    problem = Problem(
        x, [x * y >= 1, x**2 + y**2 <= 4, x == y / 2], lower=[-1, -np.inf], upper=[2.5, 3]
    )
    a, b = (Fraction(k, 8) for k in numerators)
    worst = max(
        Fraction(0), 1 - a * b, a**2 + b**2 - 4, abs(a - b / 2), -1 - a, a - Fraction(5, 2), b - 3
    )
    assert Fraction(problem.violation([float(a), float(b)])) == worst


def test_violation_without_rows_and_bounds_is_zero():
    x, y = pair()
    assert Problem(x + y).violation([1e9, -1e9]) == 0.0


@pytest.mark.parametrize("shape", [(1,), (3,), (1, 2), ()])
def test_violation_refuses_points_of_the_wrong_shape(shape):
    with pytest.raises(ProblemError, match=r"x: found shape .*, expected \(2,\)"):
        Problem(pair()[0]).violation(np.zeros(shape))


# ---- bounds and other fields -------------------------------------------------------------


@pytest.mark.parametrize(
    ("given_", "expected"),
    [
        (None, [-np.inf, -np.inf]),
        (-1, [-1.0, -1.0]),
        (np.float32(0.5), [0.5, 0.5]),
        ([-1, -2], [-1.0, -2.0]),
        ((-np.inf, 0), [-np.inf, 0.0]),
        (np.array([1, 2], np.int8), [1.0, 2.0]),
    ],
)
def test_bounds_are_broadcast(given_, expected):
    problem = Problem(pair()[0], lower=given_)
    assert problem.lower.tolist() == expected
    assert problem.lower.dtype == np.float64
    assert problem.upper.tolist() == [np.inf, np.inf]


def test_equal_bounds_fix_a_variable():
    problem = Problem(pair()[0], lower=[1, -1], upper=[1, 1])
    assert problem.violation([1.0, 0.0]) == 0.0
    assert problem.violation([1.5, 0.0]) == 0.5


def test_one_constraint_need_not_be_in_a_list():
    x, y = pair()
    assert len(Problem(x, x + y >= 1).constraints) == 1
    assert len(Problem(x, (row for row in [x >= 0, y >= 0])).constraints) == 2


def test_a_number_may_be_the_objective_when_rows_tell_the_variables():
    x, y = pair()
    problem = Problem(3, [x + y >= 1])
    assert problem.objective.constant_term == 3.0
    assert problem.objective.degree == 0
    assert problem.dimension == 2
    assert problem.names == ("x", "y")


def test_degree_is_the_largest_of_all():
    x, y = pair()
    assert Problem(x, [x * y**3 >= 0]).degree == 4
    assert Problem(x**3, [y >= 0]).degree == 3
    assert Problem(x * 0).degree == 0


def test_names_come_from_the_argument_then_the_objective_then_numbers():
    x, y = pair()
    assert Problem(x * y, names=["u", "v"]).names == ("u", "v")
    assert Problem(x * y).names == ("x", "y")
    assert Problem(sp.variables(2)[0]).names == ("x1", "x2")


def malformed():
    x, y = pair()
    z = sp.variables(3)[0]
    return {
        "objective text": (("x^2",), {}, "objective: found str"),
        "objective none": ((None,), {}, "objective: found NoneType"),
        "objective number alone": ((1.0,), {}, "objective: found float"),
        "objective a constraint": ((x >= 0,), {}, "objective: found Constraint"),
        "row a polynomial": ((x, [y]), {}, "constraints[0]: found Polynomial"),
        "row a bool": ((x, [y >= 0, True]), {}, "constraints[1]: found bool"),
        "row of other variables": ((x, [z >= 0]), {}, "constraints[0]: found 3 variables"),
        "lower too short": ((x,), {"lower": [0.0]}, "lower: found shape (1,), expected (2,)"),
        "upper a matrix": ((x,), {"upper": np.zeros((2, 1))}, "upper: found shape (2, 1)"),
        "lower text": ((x,), {"lower": "low"}, "lower: found 'low', expected numbers"),
        "upper ragged": ((x,), {"upper": [[1], [1, 2]]}, "upper: found"),
        "lower beyond doubles": ((x,), {"lower": [-(10**400), 0]}, "lower: found a number beyond"),
        "upper beyond doubles": ((x,), {"upper": 10**400}, "upper: found a number beyond"),
        "lower nan": ((x,), {"lower": [0.0, np.nan]}, "lower: found NaN for variable 2"),
        "crossed": ((x,), {"lower": [0, 2], "upper": 1}, "found [2.0, 1.0] for variable 2"),
        "lower inf": ((x,), {"lower": np.inf}, "found [inf, inf] for variable 1"),
        "upper -inf": ((x,), {"upper": [1, -np.inf]}, "found [-inf, -inf] for variable 2"),
        "too few names": ((x,), {"names": ["a"]}, "names: found 1 names, expected 2"),
        "equal names": ((x,), {"names": ["a", "a"]}, "expected 2 distinct"),
        "sense": ((x,), {"sense": "maximise"}, "sense: found 'maximise', expected 'min' or 'max'"),
        "squares numbers": (
            (x**2,),
            {"squares": [1.0]},
            "expected polynomials in the objective's variables",
        ),
        "squares dimension": (
            (x**2,),
            {"squares": [z]},
            "expected polynomials in the objective's variables",
        ),
        "squares weight": ((x**2,), {"squares": [(-1.0, x)]}, "squares: found weight -1.0"),
        "squares weight nan": ((x**2,), {"squares": [(np.nan, x)]}, "squares: found weight nan"),
        "squares identity": ((x**2 + y,), {"squares": [x]}, "differs from the objective"),
    }


@pytest.mark.parametrize("case", sorted(malformed()))
def test_malformed_input_is_named(case):
    args, keywords, message = malformed()[case]
    with pytest.raises(ProblemError, match=re.escape(message)):
        Problem(*args, **keywords)


@pytest.mark.parametrize("objective", ["x", 1j])
def test_an_objective_that_is_no_number_is_named_beside_rows_too(objective):
    with pytest.raises(ProblemError, match="objective: found"):
        Problem(objective, [pair()[0] >= 0])


def test_what_verification_reads_of_a_problem_is_read_only():
    """Another coefficient in place would be verified under the fingerprint of the first one."""
    x, y = pair()
    problem = Problem(x, [x + y == 1, sp.psd([[x, y], [y, 1.0]])], lower=-1, upper=1)
    systems = problem.rows, problem.objective_row, problem.matrices.system
    arrays = [a for s in systems for a in (s.words, s.coefficients, s.row)]
    arrays += [a for a in vars(problem.matrices).values() if isinstance(a, np.ndarray)]
    arrays += [problem.equality, problem.first_alike, problem.bound_rows, problem.lower]
    for array in (*arrays, Problem(x, [x == y]).equations):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda made: pickle.loads(pickle.dumps(made))])
def test_arrays_of_copies_are_read_only(copied):
    """Twice an objective of least value -9 has -18; a copy changed so once verified -9."""
    x, y = pair()
    problem = Problem(x * y - x, [sp.psd([[x + 9, y], [y, 9.0]])], lower=[-1, -2], upper=[3, 2])
    ratios = sp.RationalProblem(x / (x + 2), lower=-1, upper=1)
    held = problem.rows, problem.matrices, problem.matrices.system
    for made in (problem, problem.objective, *held, ratios, ratios.objective.ratios[0][0]):
        arrays = [a for a in vars(copied(made)).values() if isinstance(a, np.ndarray)]
        assert arrays and not any(array.flags.writeable for array in arrays)


def test_inputs_are_neither_modified_nor_shared():
    x, y = pair()
    lower, rows = np.array([-1.0, -2.0]), [x + y >= 0]
    problem = Problem(x, rows, lower=lower)
    lower[0] = 5.0
    rows.clear()
    assert problem.lower.tolist() == [-1.0, -2.0]
    assert len(problem.constraints) == 1
    assert lower.flags.writeable
    with pytest.raises(ValueError, match="read-only"):
        problem.lower[0] = 0.0
    with pytest.raises(AttributeError):
        problem.sense = "max"


def test_another_objective_brings_its_own_degree_and_keeps_what_the_set_has() -> None:
    x, y = pair()
    problem = Problem(x**5, [x * y >= 1], 0, squares=None)
    assert problem.degree == 5
    rows = problem.rows
    other = problem.with_objective(x + y)
    assert other.degree == 2 and other.with_objective(y**7).degree == 7
    assert other.rows is rows
    fresh = Problem(x + y, [x * y >= 1], 0)
    assert other.fingerprint == fresh.fingerprint and other.objective_row.values(
        np.array([2, 3])
    ) == [5]
    squared = Problem(1 + x**2, squares=[x])
    assert squared.squares_constant == 1.0
    assert squared.with_objective(1 + x**2).squares_constant is None


# ---- fingerprint -------------------------------------------------------------------------


def parts():
    """Everything the fingerprint must tell apart, as one flat list of doubles and kinds."""
    return {"f": [1.5, -2.0], "g": [3.0, 0.25], "kind": 0, "lower": [-1.0, -2.0], "upper": [1, 2]}


def make(data, names=None, row_name="", sense="min"):
    x, y = sp.variables(2, names)
    f = data["f"][0] * x**2 + data["f"][1] * y
    g = data["g"][0] * x * y + data["g"][1]
    row = Constraint(g, (Kind.NONNEGATIVE, Kind.ZERO)[data["kind"]], row_name)
    return Problem(f, [row], data["lower"], data["upper"], sense=sense)


@given(st.sampled_from(["f", "g", "lower", "upper"]), st.integers(0, 1), st.booleans())
@settings(max_examples=30, deadline=None)
def test_the_last_bit_of_any_number_changes_the_fingerprint(field, place, upwards):
    data = parts()
    old = make(data).fingerprint
    data[field] = list(data[field])
    data[field][place] = float(np.nextafter(data[field][place], np.inf if upwards else -np.inf))
    assert make(data).fingerprint != old
    assert make(parts()).fingerprint == old


def test_kind_order_and_number_of_rows_and_variables_change_the_fingerprint():
    x, y = sp.variables(2)
    u, v, _ = sp.variables(3)
    problems = [
        Problem(x * y, [x >= 0, y >= 0]),
        Problem(x * y, [y >= 0, x >= 0]),
        Problem(x * y, [x >= 0]),
        Problem(x * y, [x >= 0, y == 0]),
        Problem(x * y),
        Problem(x * y, lower=0),
        Problem(x * y, upper=0),
        Problem(x * y + 1),
        Problem(x * y * y),
        Problem(u * v),
    ]
    assert len({p.fingerprint for p in problems}) == len(problems)


def test_a_coefficient_moved_between_objective_and_row_changes_the_fingerprint():
    x, y = sp.variables(2)
    left = Problem(x + y, [Constraint(x * y, Kind.NONNEGATIVE)])
    right = Problem(x * y, [Constraint(x + y, Kind.NONNEGATIVE)])
    assert left.fingerprint != right.fingerprint


def test_names_sense_and_signs_of_zero_do_not_change_the_fingerprint():
    old = make(parts()).fingerprint
    assert make(parts(), names=["a", "b"]).fingerprint == old
    assert make(parts(), row_name="balance").fingerprint == old
    assert make(parts(), sense="max").fingerprint == old
    x, _ = pair()
    assert Problem(x, lower=-0.0).fingerprint == Problem(x, lower=0.0).fingerprint
    assert Problem(x + 0.0 * x**5).fingerprint == Problem(x).fingerprint


# ---- squares -----------------------------------------------------------------------------


def test_squares_constant_is_the_exact_rest():
    x, y = pair()
    f = (x - 3) ** 2 + 2 * (x * y + 1) ** 2 + 0.75
    problem = Problem(f, squares=[x - 3, (2.0, x * y + 1)])
    assert problem.squares_constant == 0.75
    assert [weight for weight, _ in problem.squares] == [1.0, 2.0]
    assert Problem(f).squares_constant is None


@given(st.lists(st.tuples(*[st.integers(-9, 9)] * 3), min_size=1, max_size=4), st.integers(-9, 9))
@settings(max_examples=40, deadline=None)
def test_squares_constant_of_random_sums_is_exact(rows, constant):
    x, y = pair()
    residuals = [a * x + b * y * x + c / 4 for a, b, c in rows]
    f = sp.total([x * 0.0, constant / 8, *(r * r for r in residuals)])
    assert Problem(f, squares=residuals).squares_constant == constant / 8


def test_squares_constant_is_rounded_down_where_it_is_no_double():
    """The constant of f - (x + 2^-30)^2 is 1 - 2^-60, which lies strictly between doubles."""
    x, _ = pair()
    tiny = 2.0**-30
    f = x**2 + 2 * tiny * x + 1.0
    constant = Problem(f, squares=[x + tiny]).squares_constant
    exact = 1 - Fraction(2) ** -60
    assert Fraction(constant) <= exact
    assert Fraction(float(np.nextafter(constant, 2.0))) > exact


def test_squares_that_hold_only_nearly_give_no_constant():
    x, _ = pair()
    r = x + 0.1  # 2 * 0.1 is exact, 0.1^2 goes to the constant; 1/3 squared is rounded
    assert Problem(r * r, squares=[r]).squares_constant is not None
    s = x / 3 + 1
    assert Fraction(1 / 3) ** 2 != Fraction((1 / 3) ** 2)
    assert Problem(s * s, squares=[s]).squares_constant is None


# ---- sympy -------------------------------------------------------------------------------


def test_sympy_expressions_make_the_same_problem():
    a, b = sympy.symbols("x1 x2")
    x1, x2 = sp.variables(2)
    symbolic = Problem(
        (a - 2) ** 2 + a * b,
        [a * b <= 3, a + b >= sympy.Rational(1, 2), sympy.Eq(a**2, 4)],
        lower=-1,
        upper=5,
    )
    plain = Problem(
        (x1 - 2) ** 2 + x1 * x2, [x1 * x2 <= 3, x1 + x2 >= 0.5, x1**2 == 4], lower=-1, upper=5
    )
    assert symbolic.fingerprint == plain.fingerprint
    assert symbolic.names == ("x1", "x2")


# ---- bounds in disguise ------------------------------------------------------------------


@given(st.integers(-20, 20).filter(bool), st.integers(-20, 20), st.sampled_from(["ge", "eq"]))
@settings(max_examples=60, deadline=None)
def test_sharpened_bounds_imply_the_rows_they_come_from(slope, constant, relation):
    """The edge -c/a is rounded inwards: at the new bound the row holds exactly."""
    x, y = pair()
    row = slope * x + constant >= 0 if relation == "ge" else slope * x + constant == 0
    problem = Problem(y, [row])
    sharp = problem.sharpened
    exact = Fraction(-constant, slope)
    if relation == "eq":  # a rational that is no double fixes nothing
        if Fraction(float(exact)) == exact:
            assert Fraction(sharp.lower[0]) == exact == Fraction(sharp.upper[0])
        else:
            assert sharp is problem
        return
    end = sharp.lower[0] if slope > 0 else sharp.upper[0]
    assert slope * Fraction(float(end)) + constant >= 0
    assert abs(Fraction(float(end)) - exact) <= abs(exact) * Fraction(2) ** -51
    assert problem.lower.tolist() == [-np.inf] * 2


def test_bound_rows_are_those_linear_in_one_variable():
    x, y = pair()
    problem = Problem(x, [x >= 1, x + y >= 1, x**2 >= 1, 2 * y == 3, x * 0.0 + 1 >= 0])
    assert problem.bound_rows.tolist() == [True, False, False, True, False]


def test_a_field_of_a_problem_can_be_replaced() -> None:
    """dataclasses.replace makes the problem again, its rounding included."""
    x, y = sp.variables(2)
    old = sp.Problem(x + y, [x**2 + y**2 <= 1], -1.0, 1.0)
    new = replace(old, objective=0.1 * x * 0.1)
    assert new.constraints == old.constraints and new.objective.degree == 1
    assert [record.place for record in new.rounding] == ["objective"]


def test_problems_are_written_in_their_own_names():
    """Names of a problem are its own, not those that its polynomials were made with."""
    x, y = sp.variables(2)
    rows = [x >= 1, sp.second_order(2, x, y), sp.psd([[1, x * y], [x * y, 1]])]
    text = str(sp.Problem(x - 2 * y, rows, names=["b", "a"]))
    assert text.splitlines() == [
        "min b - 2*a",
        "  s.t. -1 + b >= 0",
        "  s.t. second_order(2, b, a)",
        "  s.t. psd([[1, b*a], [b*a, 1]])",
    ]
    again = sp.from_json(sp.to_json(sp.parse("min x2^2 - 3*x1; s.t. x2/(1 + x1^2) >= 1; x1 <= 2")))
    assert str(again).splitlines() == [
        "min -3*x1 + x2^2",
        "  s.t. 2 - x1 >= 0",
        "  s.t. (-1 + x2 - x1^2)/(1 + x1^2) >= 0",
    ]


def test_constraints_alike_up_to_their_sign_are_known():
    """Which are equations: equalities, each once, and pairs of opposite inequalities."""
    x, y = pair()
    p, q = x**2 - 3 * y, x * y - 1
    rows = [p >= 0, q == 0, -1 * p >= 0, -1 * q == 0, p + 1 >= 0, 0 * x >= 0, 0 * x >= 0, p >= 0]
    assert Problem(x, rows).first_alike.tolist() == [0, 1, 0, 1, 4, 5, 6, 0]
    assert Problem(x, rows).equations.tolist() == [0, 1]
    assert Problem(x, [p >= 0, p >= 0, q >= 0, 2 * q <= 0]).equations.tolist() == []
    assert Problem(x, [q <= 0, q >= 0]).with_objective(y).equations.tolist() == [0]
    assert Problem(x).equations.tolist() == Problem(x).first_alike.tolist() == []


@pytest.mark.parametrize(
    ("given", "found"),
    [(3, "3"), ("x", "'x'"), (sp.variables(3)[2], "a Polynomial in 3 variables")],
)
def test_other_objectives_are_named(given, found):
    problem = sp.Problem(sp.variables(2)[0], lower=0)
    expected = f"found {found}, expected a Polynomial in 2 variables"
    with pytest.raises(sp.ProblemError, match=f"^objective: {expected}"):
        problem.with_objective(given)
    with pytest.raises(sp.ProblemError, match=rf"^objectives\[1\]: {expected}"):
        sp.solve_each(problem, [problem.objective, given])
