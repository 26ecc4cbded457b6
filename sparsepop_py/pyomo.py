"""The solver ``sparsepop`` of Pyomo: importing this module registers it.

    import pyomo.environ as pyo
    import sparsepop_py.pyomo

    results = pyo.SolverFactory("sparsepop").solve(model)

``import sparsepop_py`` registers it too, before or after Pyomo is imported.
"""

from __future__ import annotations

import sys
import time
from dataclasses import fields
from importlib import metadata
from typing import TYPE_CHECKING, Any

import sparsepop_py as sp  # its rooms are loaded by the first solve
from sparsepop_py.errors import SolverNotFound

try:
    import pyomo.environ as environ
    from pyomo.common.collections import Bunch
    from pyomo.opt import SolverResults, SolverStatus, TerminationCondition
except ImportError as error:
    raise SolverNotFound("Pyomo is not installed; pip install 'sparsepop-py[pyomo]'") from error

if TYPE_CHECKING:
    from sparsepop_py.io.other_software.pyomo_ import PyomoModel

__all__ = ["SparsePOPSolver"]

_SECONDS = 60.0  # limit where none was given: the adaptive search ends with the gap or the time

_FINISHED = {
    "OPTIMAL": (SolverStatus.ok, TerminationCondition.optimal),
    "INFEASIBLE": (SolverStatus.warning, TerminationCondition.infeasible),
    "UNBOUNDED": (SolverStatus.warning, TerminationCondition.unbounded),
    "BOUNDED": (SolverStatus.warning, TerminationCondition.feasible),
    "UNPROVED": (SolverStatus.warning, TerminationCondition.feasible),
    "LIMIT": (SolverStatus.aborted, TerminationCondition.maxTimeLimit),
    "FAILED": (SolverStatus.error, TerminationCondition.solverFailure),
}


@environ.SolverFactory.register("sparsepop", doc="Proved bounds of polynomial models")
class SparsePOPSolver:
    """Solver of polynomial Pyomo models with proved bounds.

    Parameters
    ----------
    options : mapping, optional
        Fields of :class:`~sparsepop_py.Options`; more can be set in the attribute ``options``
        and in each call. By default effort ``"auto"`` with 60 seconds.

    Attributes
    ----------
    options : Bunch
    result : Result or None
        Of the last call, with the certificate; about the minimisation that was solved.
    problem : Problem or None
        The problem of the last call.

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> import sparsepop_py.pyomo
    >>> model = pyo.ConcreteModel()
    >>> model.x = pyo.Var(bounds=(-1, 2))
    >>> model.cost = pyo.Objective(expr=model.x**3 - model.x)
    >>> solver = pyo.SolverFactory("sparsepop")
    >>> results = solver.solve(model)
    >>> pyo.check_optimal_termination(results), round(model.x.value, 4)
    (True, 0.5774)
    >>> solver.result.certificate.verify(solver.problem).ok
    True
    """

    def __init__(self, options: Any = None, **_: Any) -> None:
        self.name = "sparsepop"
        self.options = Bunch(**dict(options or {}))
        self.result: Any = None
        self.problem: Any = None

    def available(self, exception_flag: bool = True) -> bool:
        """Tell Pyomo that the solver is there.

        Parameters
        ----------
        exception_flag : bool
            Without effect: it is there.
        """
        return True

    def license_is_valid(self) -> bool:
        """Tell Pyomo that no licence is needed."""
        return True

    def version(self) -> tuple[int, ...]:
        """Return the version of the package, as numbers."""
        try:
            parts = metadata.version("sparsepop-py").split(".")
        except metadata.PackageNotFoundError:
            return (0, 0, 0)
        return tuple(int(part) for part in parts[:3] if part.isdecimal())

    def __enter__(self) -> SparsePOPSolver:
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing has to be closed."""

    def solve(
        self,
        model: Any,
        *,
        tee: bool = False,
        load_solutions: bool = True,
        timelimit: float | None = None,
        options: Any = None,
        **ignored: Any,
    ) -> Any:
        """Solve a model: its variables get the best point, the results both bounds.

        Parameters
        ----------
        model : ConcreteModel or Block
            See :func:`~sparsepop_py.from_pyomo`.
        tee : bool
            Print a summary.
        load_solutions : bool
            Set the variables of the model. Where no point is proved they stay as they are.
        timelimit : float, optional
            Seconds; ``options["time_limit"]`` is the same.
        options : mapping, optional
            Fields of :class:`~sparsepop_py.Options` for this call.
        **ignored : object
            What other solvers take, such as ``keepfiles``.

        Returns
        -------
        SolverResults
            ``problem.lower_bound`` and ``problem.upper_bound`` in the sense of the model: one
            proved, one attained. ``solver.termination_condition`` is ``optimal`` where the gap is
            closed; ``feasible`` where it is open and a point is proved.

        Raises
        ------
        ProblemError
            If the model is not polynomial or an option is wrong.
        """
        from sparsepop_py.io.other_software.pyomo_ import read_pyomo

        start = time.perf_counter()
        chosen = _options({**self.options, **dict(options or {})}, timelimit)
        read = read_pyomo(model)
        self.problem, self.result = read.problem, sp.solve(read.problem, chosen)
        if tee:
            sys.stdout.write(self.result.summary() + "\n")
        if load_solutions and self.result.attained is not None:
            _load(read, self.result.attained.x)
        return _results(model, read, self.result, time.perf_counter() - start)


def _options(given: dict[str, Any], timelimit: float | None) -> sp.Options:
    known = {field.name for field in fields(sp.Options)}
    for name in given:
        if name not in known:
            raise sp.ProblemError(
                f"options: found {name!r}, expected fields of sparsepop_py.Options"
            )
    if timelimit is not None:
        given["time_limit"] = timelimit
    given.setdefault("effort", "auto")
    if not {"time_limit", "cpu_limit", "work_limit"} & set(given):
        given["time_limit"] = _SECONDS
    return sp.Options(**given)


def _load(read: PyomoModel, x: Any) -> None:
    for variable, value in zip(read.variables, x.tolist(), strict=False):
        number = float(round(value)) if variable.is_integer() else value
        variable.set_value(number, skip_validation=True)
        variable.stale = False


def _results(model: Any, read: PyomoModel, result: Any, seconds: float) -> Any:
    problem, maximise = read.problem, read.problem.sense == "max"
    results = SolverResults()
    results.solver.name = "sparsepop"
    status, condition = _FINISHED.get(str(result.status), _FINISHED["LIMIT"])
    if condition == TerminationCondition.feasible and result.attained is None:
        condition = TerminationCondition.noSolution
    results.solver.status = status
    results.solver.termination_condition = condition
    results.solver.termination_message = result.status.message
    results.solver.message = f"{result.status}: {result.status.message}"
    results.solver.wallclock_time = seconds
    ends = (result.lower_bound, result.upper_bound)
    ends = (-ends[1], -ends[0]) if maximise else ends
    results.problem.name = model.name
    results.problem.lower_bound, results.problem.upper_bound = ends
    results.problem.sense = environ.maximize if maximise else environ.minimize
    results.problem.number_of_objectives = 1
    results.problem.number_of_variables = len(read.variables)
    results.problem.number_of_constraints = len(problem.constraints)
    return results
