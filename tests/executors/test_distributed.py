"""The same bounds from processes, Dask, Ray and MPI as from this process."""

from __future__ import annotations

import os
import pickle
import shutil
import subprocess
import sys
import warnings
from collections.abc import Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import setid
import sparsepop_py as sp
from sparsepop_py.errors import SolverNotFound
from sparsepop_py.executors.processes import Processes


@contextmanager
def processes() -> Iterator[Executor]:
    with Processes(2) as pool:
        yield pool


@contextmanager
def dask() -> Iterator[Executor]:
    pytest.importorskip("distributed", reason="Dask is the optional extra dask")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own
        from distributed import Client, LocalCluster

        with (
            LocalCluster(
                n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
            ) as cluster,
            Client(cluster) as client,
            client.get_executor() as pool,
        ):
            yield pool


@contextmanager
def ray() -> Iterator[Executor]:
    pytest.importorskip("ray", reason="Ray is the optional extra ray")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own
        import ray

        from sparsepop_py.executors.ray_ import RayExecutor

        ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
        try:
            with RayExecutor() as pool:
                yield pool
        finally:
            ray.shutdown()


ENGINES = {
    "processes": pytest.param(processes, id="processes"),
    "dask": pytest.param(dask, id="dask", marks=pytest.mark.slow),
    "ray": pytest.param(ray, id="ray", marks=pytest.mark.slow),
}


def squares(path: Path) -> sp.Study:
    """Minimise x^2 - 2 c x on [0, 20]: -c^2, where x = c."""
    (x,) = sp.variables(1)
    study = sp.Study(path)
    for c in range(1, 7):
        study.add(f"centre {c}", sp.Problem(x**2 - 2 * c * x, lower=0, upper=20))
    return study


@pytest.mark.parametrize("engine", list(ENGINES.values()))
def test_a_study_has_the_same_table(engine, tmp_path: Path) -> None:
    here = squares(tmp_path / "here.study")
    here.run()
    there = squares(tmp_path / "there.study")
    with engine() as pool:
        assert there.run(executor=pool).finished
    assert there.table() == here.table()
    for c, row in enumerate(there.table(), 1):
        assert row["lower_bound"] <= -(c**2) <= row["upper_bound"]


MPI = """
import sys
from mpi4py.futures import MPIPoolExecutor
sys.path[:0] = {paths!r}
from test_distributed import squares
from pathlib import Path
if __name__ == "__main__":
    study = squares(Path({path!r}))
    with MPIPoolExecutor() as pool:
        study.run(executor=pool)
"""


@pytest.mark.slow
def test_a_study_by_mpi_has_the_same_table(tmp_path: Path) -> None:
    pytest.importorskip("mpi4py", reason="mpi4py needs an MPI library")
    mpiexec = shutil.which(
        "mpiexec", path=str(Path(sys.executable).parent) + os.pathsep + os.environ["PATH"]
    )
    if mpiexec is None:
        pytest.skip("mpiexec comes with an MPI library, not with Python packages")
    here = squares(tmp_path / "here.study")
    here.run()
    script, path = tmp_path / "script.py", tmp_path / "there.study"
    script.write_text(MPI.format(paths=[str(Path(__file__).parent)], path=str(path)))
    call = [
        mpiexec,
        "-n",
        "3",
        "--oversubscribe",
        sys.executable,
        "-m",
        "mpi4py.futures",
        str(script),
    ]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    }
    subprocess.run(call, check=True, env=environment, timeout=300)
    assert sp.Study(path).table() == here.table()


# ---- functions that take executor= ---------------------------------------------------------------

DATA = setid.IOData(
    [1, -1, 2, 0, 1, -2, 1, 3],
    setid.simulate(setid.TransferFunction(1, 2), [-0.5, 0, 1], [1, -1, 2, 0, 1, -2, 1, 3]),
)


@pytest.mark.slow
def test_select_takes_the_same_steps() -> None:
    noise = setid.Noise(equation=1e-3)
    serial = setid.select(DATA, setid.TransferFunction, noise, [0, 1, 2])
    with processes() as pool:
        spread = setid.select(DATA, setid.TransferFunction, noise, [0, 1, 2], executor=pool)
    assert spread.log == serial.log
    assert [step.decision for step in spread.steps] == ["refuted", "kept"]
    assert spread.result.verify(DATA)


def test_bands_do_not_depend_on_the_workers() -> None:
    model = setid.TransferFunction(1, 1)
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    result = setid.identify(data, model, setid.Noise(equation=0.5))
    omega = np.linspace(0.01, 3.0, 70)  # three tasks
    bands = []
    for workers in (1, 2):
        with Processes(workers) as pool:
            bands.append(setid.frequency_band(result, omega, executor=pool))
    alone = setid.frequency_band(result, omega)
    assert np.array_equal(bands[0].magnitude, bands[1].magnitude)
    assert np.array_equal(bands[0].regions, bands[1].regions)
    assert np.allclose(bands[0].magnitude, alone.magnitude, rtol=1e-9)
    inner = setid.frequency_band(result, omega, kind="sampled")
    assert np.all(bands[1].magnitude[:, 0] <= inner.magnitude[:, 0])
    assert np.all(bands[1].magnitude[:, 1] >= inner.magnitude[:, 1])


def test_objectives_are_solved_as_tasks() -> None:
    """The disc of radius 1: x1 and x2 reach -1 and 1."""
    x1, x2 = sp.variables(2)
    problem = sp.Problem(x1, [x1**2 + x2**2 <= 1])
    seen = []
    with processes() as pool:
        results = sp.solve_each(
            problem, [x1, -x1, x2, -x2], executor=pool, on_progress=lambda *a: seen.append(a)
        )
    assert len(seen) == 4
    for result in results:
        assert result.lower_bound <= -1 <= result.upper_bound
        assert result.upper_bound - result.lower_bound < 1e-6
        assert result.certificate.verify(result.problem).ok


def test_nodes_go_to_an_executor_by_keyword() -> None:
    """Trees may differ, for eight nodes are taken at once; each bound is proved."""
    problem = sp.problems.random_quartic(3, seed=4)
    options = sp.Options(effort="auto", work_limit=np.inf, node_limit=16)
    with ThreadPoolExecutor(2) as pool:
        spread = sp.solve(problem, options, executor=pool)
        each = sp.solve_each(problem, [problem.objective], options, executor=pool)[0]
    alone = sp.solve(problem, options)
    for result in (spread, each):
        assert result.lower_bound <= alone.upper_bound and alone.lower_bound <= result.upper_bound
        assert pickle.loads(pickle.dumps(result)).options.executor is None


def test_identify_takes_an_executor() -> None:
    data = setid.IOData([4, -3, 2, 1], [0, -6.25, 1.175, 2.0875])
    noise, model = setid.Noise(output=0.3), setid.TransferFunction(1, 1)
    with ThreadPoolExecutor(2) as pool:
        result = setid.identify(data, model, noise, setid.Stable(), executor=pool)
    assert result.verify(data)
    assert pickle.loads(pickle.dumps(result)).options.engine.executor is None


def test_ray_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    from sparsepop_py.executors.ray_ import RayExecutor

    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(SolverNotFound, match="pip install ray"):
        RayExecutor()
