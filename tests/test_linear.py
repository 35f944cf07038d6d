"""Linear solves: every solver gives the same solution, a stale factor still gives the right one, failures are named."""

import subprocess
import sys

import numpy as np
import pytest
import scipy.sparse as sp
from fixtures.cases import CASES
from fixtures.tangents import Problem
from numpy.testing import assert_allclose
from threadpoolctl import threadpool_limits

from indentfit.errors import ConvergenceError, InputError
from indentfit.fem.linear import pardiso
from indentfit.fem.linear.solver import LinearSolver
from indentfit.fem.linear.tangent import Tangent


@pytest.fixture(scope="module")
def problem():
    return Problem()


def installed(kind):
    if kind == "pardiso":
        try:
            pardiso.load()
        except ImportError:
            pytest.skip("PARDISO is not installed")
    return kind


@pytest.mark.parametrize("kind", ["pardiso", "superlu", "pyamg"])
def test_every_solver_gives_the_same_solution(problem, kind):
    solver = LinearSolver(installed(kind), problem.modes)
    assert solver.name == kind
    x = solver.solve(Tangent(problem.A), problem.b, tolerance=1e-10)
    dense = np.linalg.solve(problem.A.toarray(), problem.b)
    assert np.linalg.norm(problem.A @ x - problem.b) <= 1e-10 * np.linalg.norm(problem.b)
    assert_allclose(x, dense, atol=1e-6 * np.max(np.abs(dense)))
    assert solver.work.factorizations == solver.work.solves == 1


def steps_of_multigrid(bulk_ratio, elements):
    """Steps of GMRES for a load on the top of the sample at rest; the solution is looked at."""
    here = Problem(bulk_ratio, elements=elements)
    solver, rest = LinearSolver("pyamg", here.fixed.freed(here.modes)), np.zeros_like(here.u)
    bulk = solver.bulk(here.kappa, here.mu)
    (soft, _), (A, _) = here.tangent(rest, bulk), here.tangent(rest)
    B = here.fixed.dilatation(here.solid.dilatation_map(rest))
    b = here.pressed().astype(float)
    x = solver.solve(Tangent(soft, None, None, B, here.kappa, bulk, here.mu), b, 1e-6)
    assert np.linalg.norm(A @ x - b) <= 1.01e-6 * np.linalg.norm(b)  # A holds the whole of kappa
    return solver.work.krylov_iterations


def test_steps_of_multigrid_grow_little_with_the_mesh_and_the_bulk_modulus():
    coarse, fine = ([steps_of_multigrid(bulk_ratio, elements) for bulk_ratio in (20.0, 1000.0)] for elements in (600, 3000))
    assert all(many < 2 * few for few, many in zip(coarse, fine, strict=True))
    assert fine[1] < 2 * fine[0]


def with_contact(problem, surface, C):
    """The tangent with a dense contact C on some of the dofs."""
    places = np.ix_(surface, surface)
    whole = problem.A.tolil()
    whole[places] = whole[places].toarray() + C
    whole = whole.tocsr()
    whole.sort_indices()
    return Tangent(whole, problem.A, C)


@pytest.mark.parametrize(("kind", "steps"), [("pardiso", 12), ("pardiso in double precision", 8), ("superlu", None)])
def test_the_contact_may_be_unsymmetric_and_change_without_a_new_factor_of_the_body(problem, kind, steps):
    kind, _, double = kind.partition(" ")
    surface = np.flatnonzero(problem.b)[::20]
    solver, rng = LinearSolver(installed(kind), surface=surface), np.random.default_rng(1)
    if double:
        assert solver.sharpen()
    C = rng.standard_normal((surface.size,) * 2)
    few = C.copy()
    few[:3, :3] += 100 * rng.standard_normal((3, 3))
    few[7, :] += 1e-6
    for contact in (C, few, 10 * C, np.zeros_like(C)):
        tangent = with_contact(problem, surface, contact)
        if kind == "superlu":
            solver.forget()
        exact = np.linalg.solve(tangent.whole.toarray(), problem.b)
        assert_allclose(solver.solve(tangent, problem.b, 1e-10), exact, atol=1e-6 * np.max(np.abs(exact)))
    if kind == "pardiso":
        assert solver.work.factorizations == 1
        assert solver.work.krylov_iterations <= steps  # of four solves: the contact of the tangent is in the preconditioner


@pytest.mark.parametrize("kind", ["pardiso", "superlu"])
def test_a_stale_factor_solves_the_current_matrix(problem, kind):
    solver = LinearSolver(installed(kind))
    solver.solve(Tangent(problem.A), problem.b)
    B, _ = problem.tangent(1.2 * problem.u)
    for tolerance in (1e-4, 1e-8):
        x = solver.solve(Tangent(B), problem.b, tolerance)
        assert np.linalg.norm(B @ x - problem.b) <= tolerance * np.linalg.norm(problem.b)
    assert solver.work.factorizations == 1
    assert solver.work.krylov_iterations > 0
    old = LinearSolver(kind).solve(Tangent(problem.A), problem.b, 1e-12)
    assert np.linalg.norm(B @ old - problem.b) > 1e-4 * np.linalg.norm(problem.b)  # the matrix did change


@pytest.mark.parametrize("kind", ["pardiso", "superlu"])
def test_a_matrix_too_far_from_the_factor_is_factorised_anew(problem, kind):
    solver, rng = LinearSolver(installed(kind)), np.random.default_rng(2)
    solver.solve(Tangent(problem.A), problem.b)
    n = problem.A.shape[0]
    B = problem.A.copy()
    B.data *= np.exp(rng.uniform(-3, 3, B.data.size))
    B.setdiag(B.diagonal() + 20 * np.abs(B).sum(axis=1).max() * rng.uniform(0.01, 1, n))
    x = solver.solve(Tangent(B), problem.b, 1e-8)
    assert np.linalg.norm(B @ x - problem.b) <= 1e-8 * np.linalg.norm(problem.b)
    assert solver.work.factorizations == 2


def test_forget_asks_for_a_new_factor(problem):
    solver = LinearSolver()
    solver.solve(Tangent(problem.A), problem.b)
    solver.solve(Tangent(problem.A), problem.b)
    assert solver.work.factorizations == 1
    solver.forget()
    solver.solve(Tangent(problem.A), problem.b)
    assert solver.work.factorizations == 2


def test_no_load_no_displacement(problem):
    solver = LinearSolver()
    assert not solver.solve(Tangent(problem.A), np.zeros_like(problem.b)).any()
    assert solver.work.factorizations == 0


@pytest.mark.parametrize("kind", ["pardiso", "superlu", "pyamg"])
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_nan_and_infinity_are_refused(problem, kind, wrong):
    A, b = problem.A.copy(), problem.b.copy()
    A.data[7] = wrong
    with pytest.raises(ConvergenceError, match="NaN"):
        LinearSolver(installed(kind), problem.modes).solve(Tangent(A), problem.b)
    b[3] = wrong
    with pytest.raises(ConvergenceError, match="NaN"):
        LinearSolver(installed(kind), problem.modes).solve(Tangent(problem.A), b)


@pytest.mark.parametrize("kind", ["pardiso", "superlu"])
def test_a_body_without_support_is_refused(kind):
    loose = Problem(supported=False)
    with pytest.raises(ConvergenceError, match="singular"):
        LinearSolver(installed(kind)).solve(Tangent(loose.A), loose.b)


def test_what_single_precision_cannot_solve_is_factorised_in_double():
    kind = installed("pardiso")
    hard = Problem(bulk_ratio=1e9)
    solver = LinearSolver(kind)
    for _ in range(2):
        x = solver.solve(Tangent(hard.A), hard.b, 1e-6)
        assert np.linalg.norm(hard.A @ x - hard.b) <= 1e-6 * np.linalg.norm(hard.b)
    assert solver.work.factorizations == 2  # one in each precision, and the second stays


@pytest.mark.parametrize("kind", ["pardiso", "superlu"])
def test_a_matrix_with_an_empty_row_is_refused(problem, kind):
    A = problem.A.copy()
    free = np.flatnonzero(problem.b)[0]
    A.data[A.indptr[free] : A.indptr[free + 1]] = 0
    A.data[A.indices == free] = 0
    solver = LinearSolver(installed(kind))
    with pytest.raises(ConvergenceError, match="singular"):
        solver.solve(Tangent(A), problem.b)
    x = solver.solve(Tangent(problem.A), problem.b)  # and the solver is still good for the next matrix
    assert np.linalg.norm(problem.A @ x - problem.b) <= 1e-4 * np.linalg.norm(problem.b)


def test_without_pardiso_superlu_takes_over_and_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "pypardiso", None)
    assert LinearSolver("auto").name == "superlu"
    with pytest.raises(InputError, match="not installed"):
        LinearSolver("pardiso")


def test_rigid_body_modes_need_no_force():
    loose = Problem(supported=False)
    at_rest, _ = loose.tangent(np.zeros_like(loose.u))
    assert np.linalg.matrix_rank(loose.modes) == 6
    assert np.max(np.abs(at_rest @ loose.modes)) < 1e-11 * np.max(np.abs(at_rest.data))


def test_a_factor_is_made_by_as_many_threads_as_its_analysis():
    """MKL crashed where one thread factorised what two had analysed: the process that loads it late limits it late."""
    installed("pardiso")
    n, surface, held = 400, np.arange(0, 60, 2), np.array([4, 7, 300, 399])
    free = np.isin(np.arange(n), held, invert=True)
    matrix = sp.diags([-1.0, -1.0, 4.5, -1.0, -1.0], [-20, -1, 0, 1, 20], shape=(n, n)).tocsr()
    matrix.data *= np.repeat(free, np.diff(matrix.indptr)) & free[matrix.indices]  # zeros that are stored
    matrix.setdiag(4.5)
    library = pardiso._Library(pardiso._Pattern.of(matrix, surface, held), np.float64)
    inside = np.setdiff1d(np.arange(n), surface)
    full = matrix.toarray()
    schur = full[np.ix_(surface, surface)] - full[np.ix_(surface, inside)] @ np.linalg.solve(
        full[np.ix_(inside, inside)], full[np.ix_(inside, surface)]
    )
    for threads in (2, 1, 2):
        with threadpool_limits(threads):
            assert library.factorize(matrix) == pytest.approx(schur, abs=1e-10)
            assert library._analysed_with == library._threads()
            assert library.call(pardiso.SOLVE, np.arange(n) + 1.0) == pytest.approx(np.linalg.solve(full, np.arange(n) + 1.0))


def test_a_bench_loads_the_library_before_its_threads_are_limited(tmp_path):
    lines = (
        "import sys",
        "from indentfit.experiment.measured import read_case",
        "from indentfit.runs.bench import Bench",
        "from indentfit.runs.mechanics import mechanics_of",
        f"Bench(mechanics_of(read_case({str(CASES / 'quickstart' / 'case.toml')!r})))",
        "print('pypardiso' in sys.modules)",
    )
    pytest.importorskip("pypardiso")
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], cwd=tmp_path, capture_output=True, text=True)
    assert (done.stdout.strip(), done.stderr) == ("True", "")


def test_the_contact_acts_on_loaded_dofs_alone_and_more_of_them_may_come():
    rng, n = np.random.default_rng(3), 40
    half = rng.normal(size=(n, n))
    S = half @ half.T + n * np.eye(n)
    interface = pardiso._Interface(S)
    for loaded in ([], [3, 4, 5], [3, 5], [0, 3, 39], range(n)):
        C = np.zeros((n, n))
        C[np.ix_(loaded, loaded)] = 20 * rng.normal(size=(len(loaded),) * 2)  # slip is not symmetric
        r = rng.normal(size=(2, n))
        assert interface.nearly_exact(C)(r) == pytest.approx(np.linalg.solve(S + C, r.T).T, rel=1e-9, abs=1e-12)
        assert interface.nearly_exact(C)(r[0]) == pytest.approx(np.linalg.solve(S + C, r[0]), rel=1e-9, abs=1e-12)
