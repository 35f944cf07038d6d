"""The methods paragraph of a fit, ready to paste into a paper: what was modelled, fitted and found, with numbers and references."""

from collections.abc import Iterator

from indentfit.inference.result import FitResult
from indentfit.inference.shares import BY_RESIDUALS, DISCREPANCY
from indentfit.report.first_screen import pieces_words, value_words
from indentfit.report.formulas import lined
from indentfit.report.html_case import number
from indentfit.report.page import Lines, Part, Section, Text
from indentfit.report.schema import CaseFacts, Stored
from indentfit.report.text import KINDS

METHODS = {
    "ga": "a genetic algorithm with a surrogate of the force curves, and Gauss-Newton steps from its best point",
    "least_squares": "least squares from several start points",
    "differential_evolution": "differential evolution with a surrogate of the force curves",
    "cma": "the covariance matrix adaptation evolution strategy with a surrogate of the force curves",
}
OF_PROFILES = (
    "Raue A et al. (2009) Bioinformatics 25:1923-1929, doi 10.1093/bioinformatics/btp358 (profile likelihood)",
    "JCGM 100:2008, Guide to the expression of uncertainty in measurement, annex G (degrees of freedom)",
)
REFERENCES = (
    "Feng Y, Lee C-H, Sun L, Ji S, Zhao X (2017) J Mech Behav Biomed Mater 65:490-501, doi 10.1016/j.jmbbm.2016.09.020 (inverse "
    "method, equation (1))",
    "Gustafsson T, McBain GD (2020) J Open Source Softw 5:2369, doi 10.21105/joss.02369 (scikit-fem)",
)


def methods_section(stored: Stored, result: FitResult) -> list[Section]:
    """The section with the paragraph; nothing without a case, or where no parameter has a meaning."""
    if stored.case is None or result.no_fit or not result.success:
        return []
    paragraphs = (" ".join(_model(stored.case, result)), " ".join(_fit(stored, result)), " ".join(_found(result)))
    references = REFERENCES if _is_joint(result) else (REFERENCES[0], *OF_PROFILES, *REFERENCES[1:])
    parts: tuple[Part, ...] = (*(Text(paragraph) for paragraph in paragraphs), Lines(references))
    return [Section("methods", "Methods, ready to paste", parts)]


def _model(case: CaseFacts, result: FitResult) -> Iterator[str]:
    """What was modelled."""
    material = case.material
    name = (material.model or "typed-in energy").replace("_", " ")
    if case.sample:
        yield f"The sample ({case.sample}) and the indenter ({case.indenter}) were modelled by finite elements at large strain"
        mesh = result.mesh
        if mesh and mesh.elements:
            kind = KINDS.get(("axisymmetric" if mesh.symmetry == "axisymmetric" else "bricks", mesh.element), "elements")
            part = "the meridian plane" if mesh.symmetry == "axisymmetric" else f"the {mesh.part}"
            yield f"with {mesh.elements:,} {kind} of {part} ({mesh.dofs:,} degrees of freedom), with contact by penalty springs."
        else:
            yield "with contact by penalty springs."
    bulk = f"a bulk modulus of {number(material.kappa)} kPa" if material.kappa else ""
    bulk = bulk or (f"a bulk modulus of {number(material.bulk_ratio)} shear moduli" if material.bulk_ratio else "")
    bulk = bulk or f"a Poisson's ratio of {number(material.poisson_ratio)}"
    if case.layers:
        yield f"The layers, from the top, followed hyperelastic laws ({'; '.join(case.layers)}): {_first_sentence(case.equation)}"
        return
    bulk = "an unknown bulk modulus" if case.bulk_doubt else bulk
    yield f"The material followed the hyperelastic law {name} with {bulk}: {_first_sentence(case.equation)}"


def _first_sentence(equation: str) -> str:
    words = lined(" ".join(equation.split()).partition(". ")[0])
    return f"{words.rstrip('.')}."


def _fit(stored: Stored, result: FitResult) -> Iterator[str]:
    """What was fitted to what, and how the intervals were found."""
    assert stored.case is not None
    tests = ", ".join(
        f"{test.name} ({test.points} points to {test.depth}{'' if 'strain' in test.depth else ' mm'})" for test in stored.case.tests
    )
    kind = "synthetic" if len(stored.synthetic) == len(stored.case.tests) else "measured"
    version = result.versions.get("indentfit", "")
    fitted = f"Its parameters {', '.join(result.free)} were fitted to the {kind} forces of {tests} with indentfit {version}, by "
    inputs = result.uncertain.inputs
    if _is_joint(result):
        yield fitted + " ".join(_jointly(result))
        return
    yield (
        f"{fitted}{METHODS.get(result.method, result.method)} ({result.nfev} sets of parameters), which made the weighted sum of "
        "the root mean square errors least (Feng et al. 2017)."
    )
    others = [name for name in inputs if name not in ("mesh", "noise")]
    mesh = inputs.get("mesh")
    sources = ["the noise of the residuals, whose autocorrelation was taken into account"]
    sources += [f"the error of the mesh (±{mesh.sd:.2%} of the force)"] if mesh and mesh.sd else []
    sources += [f"the stated uncertainty of {', '.join(others)}"] if others else []
    yield (
        f"Intervals are 95 % profile likelihoods (Raue et al. 2009) of {'; '.join(sources)}; the limit of χ² follows Student's t "
        "with Welch and Satterthwaite's degrees of freedom (JCGM 100:2008)."
    )
    yield from _known(result)


def _is_joint(result: FitResult) -> bool:
    """Whether uncertain inputs were coordinates of the fit."""
    return any(share.prior is not None for share in result.uncertain.inputs.values())


def _jointly(result: FitResult) -> Iterator[str]:
    """How uncertain inputs were fitted beside the parameters; the words go on from "by"."""
    inputs = result.uncertain.inputs
    fitted = {name: share for name, share in inputs.items() if share.fitted is not None and name != DISCREPANCY}
    priors = "; ".join(
        f"{name}, {share.prior}{'' if share.unit in (None, '1') else f' {share.unit}'}" for name, share in fitted.items()
    )
    beside = ", ".join(fitted) or ("the alternatives" if result.uncertain.alternatives else "")
    yield f"a joint search over the parameters{beside and f' and {beside}'} on a surrogate of"
    yield f"{result.nfev} sets of parameters{' and inputs' if fitted else ''}."
    if priors:
        yield f"These inputs had priors ({priors})."
    if result.uncertain.alternatives:
        weighed = "; ".join(f"{each.name}, probability {each.probability:.2f}" for each in result.uncertain.alternatives)
        smooth = any(BY_RESIDUALS in said for said in result.conclusions)
        how = "the sizes of their residuals, which are smooth" if smooth else "their evidence"
        yield f"Alternatives were fitted each and weighed by {how} ({weighed})."
    if known := result.law_misfit:
        size = f"{known.scale:.2g}, found with the parameters," if known.interval else f"{known.scale:g}"
        yield "The law's own misfit was a Gaussian process along each curve, which vanishes at small strains (Kennedy and O'Hagan"
        yield f"2001): its standard deviation at the largest depth was {size} of the force there, and its length"
        yield f"{known.length:g} of the depth."
    mesh = inputs.get("mesh")
    error = f", with the error of the mesh (±{mesh.sd:.2%} of the force) as a correlated term" if mesh and mesh.sd else ""
    yield f"Intervals are the smallest sets that hold 95 % of the posterior of parameters, inputs and noise{error}."
    yield from _known(result)


def _known(result: FitResult) -> Iterator[str]:
    """The inputs that were taken as exact."""
    if result.taken_as_known:
        known = "; ".join(f"{given.input} {given.taken}" for given in result.taken_as_known)
        yield f"These inputs were taken as exactly known: {known}."


def _found(result: FitResult) -> Iterator[str]:
    """The values, with their intervals and verdicts, and the misfit."""
    values = []
    for name in result.free:
        known = result.parameters[name]
        unit = "" if known.unit in ("", "1") else f" {known.unit}"
        kind = (known.verdict or "").partition(":")[0].partition("(")[0].partition(";")[0].strip()
        values.append(f"{name} = {value_words(known)}{unit} (95 % interval {pieces_words(known)}{unit}; {kind})")
    yield f"We found {'; '.join(values)}."
    if result.misfit:
        off = ", ".join(f"{name} {known.relative:.2%}" for name, known in result.misfit.items())
        yield f"The root mean square error over the largest force was {off}."
