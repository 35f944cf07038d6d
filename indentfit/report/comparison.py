"""A comparison of laws as text and as a figure."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from indentfit.arrays import Array
from indentfit.inference.plain import by_error, span
from indentfit.report.study_text import aligned
from indentfit.study.compare import Comparison, LawFit, LawParameter

PRIORS = (
    "evidences are integrals over the ranges of the parameters, each parameter uniform over its range: another range changes them "
    "(ten times as wide: less by about 2.3); a modulus of the case has the automatic range of the other laws where that is "
    "narrower; the errors of predictions need no range"
)
CUT = 0.05  # least half height of the axis of residuals, over the largest force


def comparison_lines(result: Comparison) -> Iterator[str]:
    """A Comparison in words, line by line."""
    yield f"{result.sentence[:1].upper()}{result.sentence[1:]}."
    yield ""
    yield from aligned(comparison_rows(result))
    yield ""
    for law in result.laws:
        yield f"{law.law}: {', '.join(f'{name} {parameter_words(known)}' for name, known in law.parameters.items()) or '–'}"
        if law.cause:
            yield f"          {law.cause}"
    yield f"note      {PRIORS}"
    if any(law.nested is not None for law in result.laws):
        yield "note      the evidences are those of nested sampling (dynesty), with its standard errors"
    yield f"note      the noise's size and smoothness are integrated out, as for every law; {mesh_words(result)}"


def comparison_rows(result: Comparison) -> list[list[str]]:
    """A header and a row for each law."""
    parts = list(dict.fromkeys(part for law in result.laws for part in law.left_out))
    rows = [["law", "parameters", "log evidence", "probability", "misfit", *(f"{part} predicted" for part in parts), "runs"]]
    best = best_evidence(result)
    for law in result.laws:
        if law.log_evidence is None:
            rows.append([law.law, "", "no fit", *[""] * (len(parts) + 3)])
            continue
        left_out = [share(law.left_out.get(part)) for part in parts]
        count = str(len(law.parameters))
        below = f"{law.log_evidence - best:+.1f}" if law.log_evidence != best else "best"
        below += f" (+- {law.nested_error:.2f})" if law.nested_error is not None else ""
        rows.append([law.law, count, below, probability(law.probability), share(worst_misfit(law)), *left_out, str(law.runs)])
    return rows


def best_evidence(result: Comparison) -> float:
    """The largest log evidence."""
    return max(law.log_evidence for law in result.laws if law.log_evidence is not None)


def worst_misfit(law: LawFit) -> float | None:
    """The largest RMSE of a test over its largest force."""
    return max(law.misfit.values(), default=None)


def probability(value: float) -> str:
    """A probability; one that is tiny has no digits."""
    return "< 0.001" if value < 0.001 else "> 0.999" if value > 0.999 else f"{value:.3g}"


def share(value: float | None) -> str:
    """A share in percent."""
    return "–" if value is None else f"{100 * value:#.2g}".rstrip(".") + " %"


def mesh_words(result: Comparison) -> str:
    """What the comparison takes for the error of the mesh."""
    if not result.mesh:
        return "the mesh is taken as exact"
    return f"the error of the mesh is taken as {result.mesh:.1%} of the forces, smooth along each curve"


def parameter_words(known: LawParameter) -> str:
    """A parameter with its interval; one at its bound has an end of the interval only."""
    unit = "" if known.unit in ("", "1") else f" {known.unit}"
    low, high = known.interval
    if known.at_bound == "lower":
        return f"< {high:.3g}{unit}"
    if known.at_bound == "upper":
        return f"> {low:.3g}{unit}"
    return f"{by_error(known.value, (high - low) / 4, 4)}{unit} ({span(known.interval)})"


def comparison_figure(result: Comparison, path: Any = None) -> Any:
    """The matplotlib Figure of a comparison: what each law leaves of each curve, and the log evidences."""
    from indentfit.report import comparison_plot  # imported here, because matplotlib is slow and the functions above do not need it

    fitted = [law for law in result.laws if law.log_evidence is not None]
    left = {name: {law.law: _left(result, law, name) for law in fitted} for name in result.measured}
    depths = {name: curve.displacement for name, curve in result.measured.items()}
    best = best_evidence(result)
    bars = [(law.law, best - (law.log_evidence or 0.0)) for law in fitted]
    return comparison_plot.laws(depths, left, bars, result.threshold, path)


def _left(result: Comparison, law: LawFit, test: str) -> Array:
    """Fitted minus measured force, in percent of the largest force."""
    measured = result.measured[test].force
    return np.asarray(100 * (law.curves[test].force - measured) / np.abs(measured).max())
