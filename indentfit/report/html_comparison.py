"""The page of a comparison of laws."""

from indentfit.report.comparison import (
    PRIORS,
    best_evidence,
    comparison_figure,
    comparison_rows,
    mesh_words,
    parameter_words,
    share,
    worst_misfit,
)
from indentfit.report.html_case import again_section, case_words, number, tests_table
from indentfit.report.page import Figures, Lines, Page, Part, Section, Table, Text, drawn
from indentfit.report.schema import Stored
from indentfit.study.compare import Comparison

OUT_OF_SAMPLE = (
    "Deep third: each law is fitted to the shallow two thirds of the curves and predicts the rest. A test's name: each law is "
    "fitted to the other tests and predicts this one. Both are errors over the largest force of a test."
)


def comparison_page(stored: Stored, result: Comparison) -> Page:
    """Page of a comparison's result folder."""
    decided = result.preferred is not None
    headline = f"The curves prefer {result.preferred}." if decided else "The curves prefer none of these laws."
    if not decided and len(result.rivals) > 1:
        headline = "The curves cannot tell these laws apart."
    lead = f"{result.sentence[:1].upper()}{result.sentence[1:]}."
    sections = (_what(stored), _laws(result), _parameters(result), again_section(stored, _command(result)))
    return Page(result.title or "Comparison of laws", "Comparison of laws", headline, lead, decided, sections)


def _command(result: Comparison) -> str:
    laws = ",".join(law.law for law in result.laws)
    layer = f" --layer '{result.layer}'" if result.layer else ""
    return f"compare --materials '{laws}'{layer}"


def _what(stored: Stored) -> Section:
    parts: list[Part] = []
    if stored.case:
        parts += [Lines(case_words(stored.case)), tests_table(stored.case, "Curves on which the laws were compared")]
    return Section("what", "What was compared on what", tuple(parts))


def _laws(result: Comparison) -> Section:
    header, *rows = comparison_rows(result)
    header = [f"{cell[:1].upper()}{cell[1:]}" for cell in header]
    table = Table("Laws, the most probable first; log evidence below the best", tuple(header), tuple(map(tuple, rows)))
    caption = (
        "What each law leaves of each curve (laws that are far off leave the axes), and how far its log evidence is below the "
        f"best; differences below {result.threshold:g} (dashed) cannot tell."
    )
    parts: list[Part] = [Figures((drawn(comparison_figure(result), caption, _alt(result)),)), table, Text(OUT_OF_SAMPLE)]
    parts += [Text(f"{words[:1].upper()}{words[1:]}.") for words in (PRIORS, mesh_words(result))]
    return Section("laws", "The laws", tuple(parts))


def _alt(result: Comparison) -> str:
    best = best_evidence(result)
    words = [
        f"{law.law}: misfit {share(worst_misfit(law))}, log evidence {best - law.log_evidence:.1f} below the best"
        for law in result.laws
        if law.log_evidence is not None
    ]
    return f"Residuals of each law, and bars of log evidences. {'; '.join(words)}"


def _parameters(result: Comparison) -> Section:
    rows = tuple(
        (law.law, name, parameter_words(known), f"{number(known.min, 3)} to {number(known.max, 3)}")
        for law in result.laws
        for name, known in law.parameters.items()
    )
    header = ("Law", "Parameter", "Value and 95 % interval", "Range: uniform before the curves")
    parts: list[Part] = [Table("Parameters of each law", header, rows)]
    if result.modulus is not None:
        parts.append(Text(f"Automatic ranges of moduli are multiples of {number(result.modulus)} kPa, the curves' shear modulus."))
    causes = tuple(f"{law.law}: {law.cause}" for law in result.laws if law.cause)
    return Section("parameters", "Parameters", (*parts, Lines(causes)) if causes else tuple(parts))
