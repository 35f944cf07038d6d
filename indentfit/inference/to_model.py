"""The viscoelastic model beside the forces of a fit in time, which are hereditary integrals of elastic forces.

Where the two are far apart at the optimum (compressible samples, deep punches), the fit is made again with integrals that are
multiplied by the ratio of the model's forces to them over time. The ratio hardly changes with the parameters, so that the forces of
that fit are those of the model near its optimum. It costs no elastic run.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from indentfit.case import Case
from indentfit.fem.result import TimeCurve
from indentfit.inference.result import ParameterEstimate
from indentfit.inference.seen import DETERMINED, FAR
from indentfit.inverse.problem import InverseProblem
from indentfit.runs.forward import of_relaxation
from indentfit.runs.relaxing import Kernel

NEAR = 0.003  # largest relative difference from the model after such a correction
LEFT = "not determined: the forces of the fit are up to {size:.1%} from the viscoelastic model, which no interval holds"
DIFFER = "not determined: the holds of the tests do not relax over the same times, so that no single relaxation describes them"
CORRECTED = (
    "{name}: the forces of the fit are hereditary integrals, multiplied by the ratio over time of the viscoelastic model's forces "
    "to them ({most:.1%} at most) near the optimum; at the optimum the model is within {left:.2%} of them"
)


@dataclass(frozen=True, eq=False)
class Beside:
    """The viscoelastic model at one point of a fit.

    Parameters
    ----------
    words : tuple of str
        How the material relaxes, and how far the model is from the hereditary integrals.
    differences : dict of test -> largest relative difference from the forces of the fit
        With what the mesh adds to it, and without tests of which the model was not solved.
    kernel : Kernel or None
        That of the fit with the model's ratios at this point; None where the material does not relax.
    by_mesh : dict of test -> what the mesh adds to its difference
    """

    words: tuple[str, ...] = ()
    differences: dict[str, float] = field(default_factory=dict)
    kernel: Kernel | None = None
    by_mesh: dict[str, float] = field(default_factory=dict)


class Models:
    """The viscoelastic models of a fit, each solved once.

    Parameters
    ----------
    case : Case
    """

    def __init__(self, case: Case) -> None:
        self.case = case
        self._known: dict[tuple[tuple[str, float], ...], tuple[tuple[str, ...], dict[str, TimeCurve]]] = {}

    def beside(self, problem: InverseProblem, parameters: Mapping[str, float]) -> Beside:
        """The model beside the forces of a problem at parameters."""
        kernel, case = problem.kernel, self.case
        if kernel is None:
            return Beside()
        shares = {test.name: kernel.share(n, parameters) for n, test in enumerate(case.tests)}
        key = tuple(sorted({**parameters, **{f"share of {name}": share for name, share in shares.items()}}.items()))
        if key not in self._known:
            self._known[key] = of_relaxation(case, dict(parameters), shares)
        words, curves = self._known[key]
        by_test = [curves.get(test.name) for test in case.tests]
        known = kernel.to_model(
            [curve.ratio if curve else None for curve in by_test], [curve.counts if curve else None for curve in by_test]
        )
        off = known.off(kernel)
        sizes = {
            test.name: (off[n] if kernel.factors else curves[test.name].largest) + curves[test.name].error_by_mesh
            for n, test in enumerate(case.tests)
            if test.name in curves
        }
        if kernel.factors:
            names = [test.name for test in case.tests]
            most = replace(kernel, factors=()).off(kernel)
            words += tuple(CORRECTED.format(name=name, most=most[n], left=off[n]) for n, name in enumerate(names) if name in curves)
        return Beside(words, sizes, known, {name: curve.error_by_mesh for name, curve in curves.items()})

    def corrected(self, problem: InverseProblem, parameters: Mapping[str, float]) -> InverseProblem | None:
        """The problem whose forces are those of the model at parameters; None where they nearly are."""
        beside, kernel = self.beside(problem, parameters), problem.kernel
        if beside.kernel is None or kernel is None:
            return None
        size = max(beside.kernel.off(kernel).values(), default=0.0)
        return replace(problem, kernel=beside.kernel) if size > (NEAR if kernel.factors else FAR) else None


def unless_holds_differ(
    known: Mapping[str, ParameterEstimate], problem: InverseProblem, sentences: Sequence[str]
) -> dict[str, ParameterEstimate]:
    """Estimates of which no parameter of the relaxation is determined where `draining` has sentences on holds that differ."""
    names = () if problem.kernel is None or not sentences else [name for name in problem.kernel.names if name in known]
    return {**known, **{name: replace(known[name], verdict=DIFFER) for name in names}}


def unless_far(known: Mapping[str, ParameterEstimate], differences: Mapping[str, float]) -> dict[str, ParameterEstimate]:
    """Estimates of which none is determined where the forces of the fit are far from the viscoelastic model."""
    size = max(differences.values(), default=0.0)
    if size <= FAR:
        return dict(known)
    why = LEFT.format(size=size)
    determined = {name: estimate for name, estimate in known.items() if (estimate.verdict or "").startswith(DETERMINED)}
    return {**known, **{name: replace(estimate, verdict=why) for name, estimate in determined.items()}}
