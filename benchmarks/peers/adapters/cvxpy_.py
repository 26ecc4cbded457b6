"""Conic programs by cvxpy: min q'y, A y + s = b, s in a product of cones."""

import time

import cvxpy as cp
import numpy as np
import scipy.sparse as sps
from common import answer, run

_ROOT2 = float(np.sqrt(2.0))


def solve_by(name):
    """The solver of that name."""

    def solve(task, number):
        begin = time.process_time()
        p = task["programs"][number]
        rows, columns, values = p["A"]
        A = sps.csr_array((values, (rows, columns)), shape=(len(p["b"]), len(p["q"])))
        y, b = cp.Variable(len(p["q"])), np.array(p["b"])
        slack, at = b - A @ y, p["zero"]
        constraints = [slack[:at] == 0] if at else []
        if p["nonnegative"]:
            constraints.append(slack[at : at + p["nonnegative"]] >= 0)
        at += p["nonnegative"]
        for size in p["psd"]:
            count = size * (size + 1) // 2
            column, row = np.tril_indices(size)  # upper triangle, column by column
            weight = np.where(row == column, 1.0, 1.0 / _ROOT2)
            off = np.flatnonzero(row != column)
            place = np.concatenate([row + size * column, (column + size * row)[off]])
            number_ = np.concatenate([np.arange(count), off])
            spread = sps.csr_array((weight[number_], (place, number_)), shape=(size**2, count))
            block = cp.reshape(spread @ slack[at : at + count], (size, size), order="F")
            constraints.append((block + block.T) / 2 >> 0)
            at += count
        problem = cp.Problem(cp.Minimize(np.array(p["q"]) @ y), constraints)
        middle = time.process_time()
        options = {"time_limit": task["seconds"]} if name == "CLARABEL" else {}
        options = {"time_limit_secs": task["seconds"]} if name == "SCS" else options
        problem.solve(solver=name, **options)
        value = problem.value if problem.value is not None else -np.inf
        return answer(problem.status, value + p["offset"], begin=begin, middle=middle)

    return solve


if __name__ == "__main__":
    import sys

    run(solve_by(sys.argv[3]))
