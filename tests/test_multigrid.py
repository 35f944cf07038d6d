"""The V-cycle: pyamg's own cycle does the same, threads change no bit, friction that slips is left to GMRES."""

import numpy as np
import pyamg
import pytest
import scipy.sparse as sp
from fixtures.tangents import Problem
from numpy.testing import assert_allclose

from indentfit.fem.linear import multigrid
from indentfit.fem.linear.multigrid import Cycle
from indentfit.fem.linear.solver import LinearSolver
from indentfit.fem.linear.tangent import Tangent


@pytest.fixture(scope="module")
def problem():
    return Problem(elements=600)


@pytest.fixture(scope="module")
def matrix(problem):
    return sp.bsr_matrix(problem.A, blocksize=(3, 3))


def test_a_cycle_is_that_of_pyamg(problem, matrix, monkeypatch):
    monkeypatch.setattr(multigrid, "RANGES", 1)  # rows from first to last, as pyamg sweeps
    cycle = Cycle(matrix, problem.modes)
    np.random.seed(0)
    smoother = ("block_gauss_seidel", {"sweep": "symmetric"})
    options = {"strength": ("symmetric", {"theta": 0.0}), "smooth": "jacobi", "improve_candidates": None, "max_coarse": 100}
    levels = pyamg.smoothed_aggregation_solver(
        matrix, B=problem.modes, presmoother=smoother, postsmoother=smoother, coarse_solver="pinv", **options
    )
    wanted = levels.aspreconditioner(cycle="V") @ problem.b
    assert len(levels.levels) > 1
    assert_allclose(cycle(problem.b), wanted, atol=1e-4 * np.abs(wanted).max())


def test_ranges_that_are_swept_at_once_are_not_coupled_and_threads_change_no_bit(problem, matrix):
    cycle = Cycle(matrix, problem.modes)
    level = cycle._levels[0]
    ranges = [rows for group in level._groups for rows in group]
    assert sorted(row for first, stop in ranges for row in range(first, stop)) == list(range(matrix.shape[0] // 3))
    assert any(len(group) > 1 for group in level._groups)
    pattern = sp.csr_matrix((np.ones(matrix.indices.size), matrix.indices, matrix.indptr))
    for group in level._groups:
        for one in group:
            assert not any(pattern[one[0] : one[1], other[0] : other[1]].nnz for other in group if other is not one)
    found = []
    for level._threads in (1, 2, 3, 3):
        found.append(cycle(problem.b))
    assert all(np.array_equal(found[0], other) for other in found[1:])


def test_a_hierarchy_is_the_same_each_time_and_leaves_random_numbers_alone(problem, matrix):
    np.random.seed(1)
    first = Cycle(matrix, problem.modes)(problem.b)
    drawn = np.random.random()
    np.random.seed(1)
    assert np.random.random() == drawn
    assert np.array_equal(Cycle(matrix, problem.modes)(problem.b), first)


def test_slip_under_a_stiff_contact_takes_few_more_steps_than_sticking(problem):
    """The tangential force of a slipping point follows the pressure, f e m n: as large as the springs, and unsymmetric."""
    _, y, z = problem.solid.basis.doflocs[:, ::3]
    nodes = np.flatnonzero((y > y.max() - 1e-9) & (z <= 1))
    surface = (3 * nodes[:, None] + np.arange(3)).ravel()
    steps = {}
    for name, friction in (("none", 0.0), ("slip", 0.5)):
        block = 300 * problem.mu * np.array([[0, 0, 0], [0, 1, 0], [0, -friction, 0]])  # outwards, under the strip
        C = np.kron(np.eye(nodes.size), block)
        whole = problem.A.tolil()
        whole[np.ix_(surface, surface)] += C
        whole = whole.tocsr()
        whole.sort_indices()
        solver = LinearSolver("pyamg", problem.modes, surface)
        x = solver.solve(Tangent(whole, problem.A, C), problem.b, 1e-8)
        assert np.linalg.norm(whole @ x - problem.b) <= 1e-8 * np.linalg.norm(problem.b)
        steps[name] = solver.work.krylov_iterations
    assert steps["slip"] < 1.5 * steps["none"]
