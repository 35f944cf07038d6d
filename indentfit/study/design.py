"""The next experiment: which further test would determine the worst parameter best, from Fisher's information.

The information of a test at given parameters is sum (dF/dtheta)^2 / sigma^2; the information of several tests adds up. Each further
test differs from the case in one key, and is tried at both angles and at several depths. The parameters' ranges count as a weak,
uniform prior, so that every standard error is finite.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from indentfit.arrays import Array
from indentfit.case import Case, Test, require_free, require_indentations
from indentfit.case.laws import has_fibres
from indentfit.curve import Curve
from indentfit.errors import DesignError, IndentfitError
from indentfit.inference.seen import seen_sentences
from indentfit.inverse.derivatives import Underivable, curve_derivatives, evaluate_at_reference
from indentfit.inverse.objective import Target
from indentfit.inverse.problem import InverseProblem, differences_of, scale_of
from indentfit.runs.pool import RunPool
from indentfit.runs.relaxing import elastic_case
from indentfit.study.runs import Execution

NOISE = 0.01  # of the largest force, by default
DEPTHS = (0.5, 1.0, 1.5)  # of the case's largest depth
DEEPEST = 0.2  # of the thickness: equilibria at larger depths may not be found
POINTS = 24  # points of each further test
ANGLES = (0, 90)

Values = Mapping[str, float]


@dataclass(frozen=True)
class FurtherTest:
    """One further test, with the standard errors by this test and the tests of the case together.

    Parameters
    ----------
    change : str
        The changed key of the case; empty for no change.
    angle : int, degrees
    depth : float, mm
    stderr : dict of parameter -> standard error, in the parameter's unit, or None
    cause : str or None
        Why there is no standard error.
    """

    change: str
    angle: int
    depth: float
    stderr: dict[str, float] | None
    cause: str | None = None

    @property
    def words(self) -> str:
        return self.change or "as the case is"


@dataclass(frozen=True, repr=False, eq=False)
class Design:
    """Further tests, ranked by the standard error of the worst parameter.

    Parameters
    ----------
    parameters : dict of name -> value
        Parameters at which the information was computed.
    noise : float, mN
        Standard deviation of a force.
    stderr : dict of parameter -> standard error by the case's own tests
    worst : str
        The parameter whose standard error is largest, relative to its value.
    candidates : tuple of FurtherTest
        Further tests, the best for `worst` first, failed tests last.
    runs : int
        Number of runs of the forward model.
    case : Case or None
    remarks : tuple of str
        What a relaxation asks of the next test; empty where the material is elastic.
        None for a design that was read from design.json.
    """

    FORMAT: ClassVar[str] = "indentfit.design/2"

    parameters: dict[str, float]
    noise: float
    stderr: dict[str, float]
    worst: str
    candidates: tuple[FurtherTest, ...]
    runs: int
    case: Case | None = None
    remarks: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The stable keys of design.json, under the tag `format`."""
        return {
            "format": self.FORMAT,
            "parameters": self.parameters,
            "noise_mN": self.noise,
            "stderr": self.stderr,
            "worst": self.worst,
            "candidates": [asdict(test) for test in self.candidates],
            "runs": self.runs,
            **({"remarks": list(self.remarks)} if self.remarks else {}),
        }

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> "Design":
        """The design that design.json holds, in the form of this version or of 0.1."""
        tests = tuple(FurtherTest(**test) for test in value["candidates"])
        remarks = tuple(value.get("remarks", ()))
        known = value["parameters"], value["noise_mN"], value["stderr"], value["worst"], tests, value["runs"]
        return cls(*known, remarks=remarks)

    def summary(self) -> str:
        """The design in words, as the command prints it."""
        from indentfit.report.study_text import design_lines

        return "\n".join(design_lines(self))

    def plot(self, path: str | Path | None = None) -> Any:
        """The matplotlib Figure of the candidates; saved as SVG and PNG where a path is given."""
        from indentfit.report.plots import designs

        return designs(self, path)

    def write(self, folder: str | Path, overwrite: bool = False) -> None:
        """Write the result folder. Raises OutputError where the folder exists already, or cannot be written."""
        from indentfit.report.study_folder import write_design

        write_design(self, folder, overwrite)

    def __repr__(self) -> str:
        best = next((test for test in self.candidates if test.stderr), None)
        end = f"; best: {best.words}, angle {best.angle}, to {best.depth:.3g} mm" if best else ""
        return f"Design(worst parameter {self.worst}{end})"

    def _repr_html_(self) -> str:
        from indentfit.report.study_text import design_rows, html_table

        return html_table(repr(self), design_rows(self))


@dataclass(frozen=True)
class _Known:
    """The state before a further test: values of the parameters, information (p, p), noise, mN."""

    parameters: Values
    information: Array
    noise: float


def design(case: Case, parameters: Values | None = None, noise: float | None = None, execution: Execution | None = None) -> Design:
    """Which further test would determine the worst free parameter of a case best.

    Parameters
    ----------
    case : Case
    parameters : mapping of name to value
        Parameters at which the information is computed; by default the start values.
    noise : float, mN
        Standard deviation of a force; by default 1 % of the largest force of the case's tests.
    execution : Execution
        Progress, workers and cluster of the runs.

    Returns
    -------
    Design

    Raises
    ------
    CaseError
        No parameter of the case is free.
    DesignError
        The case's own tests have no derivatives.
    """
    require_free(case)
    require_indentations(case, "design", all_of_them=True)
    own_case, given, execution = case, dict(parameters or case.start_values()), execution or Execution()
    remarks, case = tuple(_of_relaxation(case, given)), elastic_case(case)
    parameters = {name: value for name, value in given.items() if name in case.law.parameters}
    variants = list(_variants(case))
    own, forces, runs = _own(case, parameters, execution)
    noise = noise or NOISE * max(float(force.max()) for force in forces)
    prior = np.diag([12 / (bounds.max - bounds.min) ** 2 for bounds in case.free.values()])
    known = _Known(parameters, prior + sum(J.T @ J for J in own) / noise**2, noise)
    now = _stderr(list(case.free), known.information)
    worst = max(case.free, key=lambda name: now[name] / (abs(parameters[name]) or case.free[name].max))
    tests: list[FurtherTest] = []
    for n, (change, variant) in enumerate(variants):
        execution.progress(n / len(variants), change or "as the case is")
        further, used = _further_tests(change, variant, known, execution)
        tests += further
        runs += used
    tests.sort(key=lambda test: test.stderr[worst] if test.stderr else np.inf)
    return Design(parameters, noise, now, worst, tuple(tests), runs, own_case, remarks)


def _of_relaxation(case: Case, parameters: Values) -> Iterator[str]:
    """What the records of a case cannot see of its relaxation, and that this design is one of elastic parameters."""
    relaxation = case.relaxation
    if relaxation is None:
        return
    yield "forces are those of an elastic material of the given moduli: rate and hold of a further test change none of these errors"
    yield from seen_sentences(case, {**relaxation.at(parameters).numbers})


def _variants(case: Case) -> Iterator[tuple[str, Case]]:
    """(the changed key in words, the changed case), with one changed key at a time."""
    yield "", case
    for key, size in case.indenter.geometry.variants(case.sample.geometry.outline.extent):
        yield f"{key} {size:g} mm", _with_indenter(case, key, size)
    for friction, words in ((0.0, "no friction"), ("stick", "sticking")):
        if case.indenter.friction != friction:
            yield words, _with_indenter(case, "friction", friction)


def _with_indenter(case: Case, key: str, value: float | str) -> Case:
    return case.model_copy(update={"indenter": case.indenter.with_key(key, value)})


def _own(case: Case, parameters: Values, execution: Execution) -> tuple[list[Array], Sequence[Array], int]:
    """Derivatives of the case's own tests, their forces, and the number of runs."""
    with RunPool(case, execution.workers, None, execution.cluster, execution.stop) as pool:
        problem = _problem(case, parameters)
        slopes = _slopes(problem, pool, parameters)
        evaluation = evaluate_at_reference(problem, pool, [parameters])[0]
        assert evaluation.forces is not None  # there were derivatives
        return slopes, problem.scaled(parameters, evaluation.forces), pool.runs


def _further_tests(change: str, variant: Case, known: _Known, execution: Execution) -> tuple[list[FurtherTest], int]:
    """The FurtherTests of one variant, at all angles and depths, from one run each to the deepest; and the number of runs."""
    deepest = max(float(variant.outputs(test)[-1]) for test in variant.tests)
    allowed = [factor for factor in DEPTHS if factor * deepest <= DEEPEST * variant.sample.thickness] or [DEPTHS[0]]
    cause, used, angles = "", 0, ANGLES if has_fibres(variant.law) else ANGLES[:1]
    while allowed:
        tests = tuple(Test(name=f"{angle}", angle=angle, depth=allowed[-1] * deepest, points=6 * POINTS) for angle in angles)
        tried = variant.model_copy(update={"tests": tests, "curves": (None,) * len(tests)})
        try:
            with RunPool(tried, execution.workers, None, execution.cluster, execution.stop) as pool:
                slopes = _slopes(_problem(tried, known.parameters), pool, known.parameters)
                used += pool.runs
            return list(_at_depths(change, tried, slopes, [factor * deepest for factor in allowed], known)), used
        except IndentfitError as error:
            cause = str(error)
            allowed = allowed[:-1]  # at a smaller depth, equilibrium may be found
    return [FurtherTest(change, angle, deepest, None, cause) for angle in angles], used


def _at_depths(change: str, case: Case, slopes: Sequence[Array], depths: Sequence[float], known: _Known) -> Iterator[FurtherTest]:
    names = list(case.free)
    for test, J in zip(case.tests, slopes, strict=True):
        for depth in depths:
            within = case.outputs(test) <= depth * (1 + 1e-9)
            rows = np.linspace(0, np.count_nonzero(within) - 1, POINTS).round().astype(int)
            more = J[within][rows]
            yield FurtherTest(change, test.direction, depth, _stderr(names, known.information + more.T @ more / known.noise**2))


def _slopes(problem: InverseProblem, pool: RunPool, parameters: Values) -> list[Array]:
    """dF/dtheta of every test, (n, n_free), mN per unit of a parameter. Raises DesignError."""
    ranges = np.array([problem.range(name) for name in problem.free])
    try:
        return [J / ranges for J in curve_derivatives(problem, pool, problem.units(parameters))]
    except Underivable as failure:
        raise DesignError(f"no design without derivatives: {failure}") from failure


def _problem(case: Case, parameters: Values) -> InverseProblem:
    """An InverseProblem whose tests have only displacements: enough for derivatives."""
    tests = tuple(Target(test.name, Curve(case.outputs(test), case.outputs(test)), 1.0) for test in case.tests)
    scale, reference = scale_of(case)
    return InverseProblem(tests, dict(parameters), case.free, scale, reference, differences_of(case))


def _stderr(names: Sequence[str], information: Array) -> dict[str, float]:
    return dict(zip(names, np.sqrt(np.diag(np.linalg.inv(information))).tolist(), strict=True))
