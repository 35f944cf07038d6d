"""The error of the mesh in an inverse problem: a correction of all curves by what a second mesh tells, and what it leaves.

The second mesh and the rule are those of `simulate` (fem.mesh_error). The relative correction is taken at one point, the optimum,
and used at all points: it changes much less from point to point than the curves do. What it leaves uncertain is a smooth function
of the depth, whose covariance becomes part of the intervals.

A contact that grows passes the elements one by one, so that both curves wave from depth to depth, that of the coarser mesh most.
The correction is therefore smooth: a few powers of the depth, fitted to the change of the force. The waves of the own mesh stay in
the residuals, where the noise that these show holds them.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case
from indentfit.fem.mesh_error import DEEPER, FOLDING, SecondMesh, compared, corrected, left_by_correction, second, unfolded_depth
from indentfit.fem.meshing import count, resized, size
from indentfit.inverse.derivatives import Underivable, last_cause
from indentfit.inverse.exploration import Watched
from indentfit.inverse.problem import InverseProblem
from indentfit.runs.forward import Evaluation, ForwardModel, Report
from indentfit.runs.mechanics import WIDER
from indentfit.runs.points import setup_of

ANOTHER_MESH = "a run for the error of the mesh was solved at a second try only, on a mesh of another kind"


@dataclass(frozen=True, eq=False)
class MeshError:
    """The error of the curves by the mesh, relative to the forces of the case's own mesh.

    Parameters
    ----------
    correction : tuple of arrays (n,), one for each test
        F times 1 + correction is the best estimate of the curve without an error of the mesh.
    covar : tuple of arrays (n, n)
        Covariance of what the correction leaves.
    elements : int
        Number of elements of the mesh with which the finest mesh was compared; of several meshes, their mean.
    finest : int
        Number of elements of the finest mesh that was used, likewise.
    remark : str
        Why meshes say little about the error, and what would help; mostly empty. Curves are not corrected then.
    """

    correction: tuple[Array, ...]
    covar: tuple[Array, ...]
    elements: int
    finest: int
    remark: str = ""

    def independent(self, test: int) -> Array:
        """Independent errors of one standard deviation each, relative, whose covariance is that of a test, (k, n)."""
        sizes, shapes = np.linalg.eigh(self.covar[test])
        return np.asarray((np.sqrt(np.maximum(sizes, 0.0)) * shapes).T, dtype=float)

    @property
    def sd(self) -> float:
        """The largest standard deviation of what the correction leaves, relative."""
        return float(np.sqrt(max(np.max(np.diag(part)) for part in self.covar)))

    @property
    def most(self) -> float:
        """The largest relative correction."""
        return float(max(np.max(np.abs(part)) for part in self.correction))


def mesh_error_at(
    case: Case, problem: InverseProblem, model: ForwardModel, parameters: Mapping[str, Any], finer: float | None = None
) -> MeshError:
    """The error of the mesh, from runs at one point on the case's own mesh and on its second mesh.

    Parameters
    ----------
    case : Case
    problem : InverseProblem
    model : ForwardModel
        Curves of the case's mesh, without a correction.
    parameters : dict of name -> value
    finer : float or None
        The second mesh has elements that are narrower by this factor, in place of the second mesh of `simulate`.

    Returns
    -------
    MeshError

    Raises
    ------
    Underivable
        A run failed, or was not solved on the mesh that was asked for.
    """
    setups = [setup_of(piece) for piece in case.pieces]
    others = [compared(setup, resized(setup, 1 / finer)) if finer else second(setup) for setup in setups]
    widths = [float(f"{size(other.setup) / size(setup):.12g}") for setup, other in zip(setups, others, strict=True)]
    different = list(dict.fromkeys(widths))
    own, *changed = _forces(problem, model, [parameters, *({**parameters, WIDER: width} for width in different)])
    there = dict(zip(different, changed, strict=True))
    parts = {n: _without_mesh(test.curve.force.size) for n, test in enumerate(problem.tests)}
    for piece, other, width in zip(case.pieces, others, widths, strict=True):
        names = {test.name for test in piece.tests}
        tests = [n for n, test in enumerate(problem.tests) if test.test in names]
        parts |= dict(zip(tests, _left(problem, tests, own, there[width], other), strict=True))
    counts = np.array([(count(setup), count(other.setup)) for setup, other in zip(setups, others, strict=True)])
    least, most = (round(float(np.mean(end))) for end in (counts.min(axis=1), counts.max(axis=1)))
    corrections, covars = zip(*(parts[n] for n in range(len(problem.tests))), strict=True)
    return MeshError(corrections, covars, least, most, FOLDING if any(_folds(problem, piece) for piece in case.pieces) else "")


def _folds(problem: InverseProblem, piece: Case) -> bool:
    """Whether the surface folds in so much at a sharp edge, in a test of one mesh, that other meshes say little."""
    names = {test.name for test in piece.tests}
    deepest = unfolded_depth(setup_of(piece)) * DEEPER
    return any(test.curve.deepest > deepest for test in problem.tests if test.test in names)


def _forces(problem: InverseProblem, model: ForwardModel, points: Sequence[Mapping[str, Any]]) -> list[tuple[Array, ...]]:
    runs = model.evaluate([problem.at_reference(point) for point in points])
    if any(run.forces is None for run in runs):
        raise Underivable(last_cause(model))
    if any(facts.get("tries", 1) > 1 for run in runs for facts in run.facts):
        raise Underivable(ANOTHER_MESH)
    return [run.forces or () for run in runs]


def _left(
    problem: InverseProblem, tests: Sequence[int], own: tuple[Array, ...], there: tuple[Array, ...], other: SecondMesh
) -> Iterator[tuple[Array, Array]]:
    """Correction, and covariance of what it leaves, of each of some tests of one mesh."""
    changes = [_relative(there[n] - own[n], own[n]) for n in tests]
    depths = [problem.tests[n].curve.displacement for n in tests]
    for n, change, depth, covar in zip(tests, changes, depths, left_by_correction(depths, changes, other), strict=True):
        yield corrected(depth, change, own[n], other), covar


def _without_mesh(n: int) -> tuple[Array, Array]:
    """No correction, and nothing that it leaves: a test without an indenter has no mesh."""
    return np.zeros(n), np.zeros((n, n))


def _relative(change: Array, force: Array) -> Array:
    """Changes over forces; 0 where there is no force."""
    return np.divide(change, force, out=np.zeros_like(change), where=force != 0)


class MeshCorrection:
    """Corrects the curves of an inverse problem for the mesh, once a search has found the place; none without a case.

    Parameters
    ----------
    case : Case or None

    Attributes
    ----------
    error : MeshError or None
        The error that was found.
    missing : str
        Why no error was found though one was looked for; empty otherwise.
    """

    def __init__(self, case: Case | None = None) -> None:
        self.case = case
        self.error: MeshError | None = None
        self.missing = ""

    def of(self, problem: InverseProblem, model: Watched, parameters: Mapping[str, Any], finer: float | None = None) -> Watched:
        """The model with its curves corrected by runs at one point; the model itself where that is not wanted or fails.

        Parameters
        ----------
        problem, model, parameters, finer
            As `mesh_error_at` takes them; a correction that the model has already is replaced.

        Returns
        -------
        Watched
        """
        if self.case is None:
            return model
        bare = model.uncorrected if isinstance(model, Corrected) else model
        try:
            self.error = mesh_error_at(self.case, problem, bare, parameters, finer)
        except Underivable as failure:
            self.missing = str(failure)
            return model
        return Corrected(bare, self.error)


class Corrected(Watched):
    """A Watched whose curves are corrected for the mesh; runs on another mesh are not corrected.

    Parameters
    ----------
    watched : Watched
        Curves without a correction.
    error : MeshError
    """

    def __init__(self, watched: Watched, error: MeshError) -> None:
        self.uncorrected, self.error = watched, error
        self.model = watched.model

    @property
    def known(self) -> list[Evaluation]:  # type: ignore[override]
        """The evaluations so far, corrected."""
        return [self._corrected(evaluation) for evaluation in self.uncorrected.known]

    def evaluate(
        self, points: Sequence[Mapping[str, Any]], report: Report | None = None, sensitivities: Collection[str] = ()
    ) -> list[Evaluation]:
        """Corrected evaluations of points."""
        return [self._corrected(evaluation) for evaluation in self.uncorrected.evaluate(points, report, sensitivities)]

    def _corrected(self, evaluation: Evaluation) -> Evaluation:
        if evaluation.forces is None or any(key.startswith("mesh.") for key in evaluation.parameters):
            return evaluation
        factors = [1 + part for part in self.error.correction]
        forces = tuple(factor * force for factor, force in zip(factors, evaluation.forces, strict=True))
        if evaluation.elastic is not None:
            evaluation = replace(evaluation, correction=tuple(factors))
        if evaluation.sensitivities is None:
            return replace(evaluation, forces=forces)
        by_test = tuple(
            {name: factor * slope for name, slope in given.items()}
            for factor, given in zip(factors, evaluation.sensitivities, strict=True)
        )
        return replace(evaluation, forces=forces, sensitivities=by_test)
