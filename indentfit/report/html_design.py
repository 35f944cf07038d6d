"""The page of a design: the next experiment."""

from indentfit.case import Range
from indentfit.case.laws import YOUNG
from indentfit.digits import quantity
from indentfit.report import plots
from indentfit.report.html_case import again_section, case_words, number, tests_table
from indentfit.report.page import Figures, Lines, Page, Part, Section, Table, drawn
from indentfit.report.schema import Stored
from indentfit.report.study_text import design_notes
from indentfit.study.design import Design


def design_page(stored: Stored, design: Design) -> Page:
    """Page of a design's result folder."""
    sections = (_what(stored, design), _tests(design), again_section(stored, _command(stored, design)))
    best = next((test for test in design.candidates if test.stderr), None)
    headline = "No further test could be computed."
    now = design.widths() or {}
    lead = f"The tests of the case leave {design.worst} worst: a 95 % interval of about ± {number(now[design.worst], 3)}."
    if best is not None and (widths := design.widths(best)):
        headline = f"Best for {design.worst}: {best.whole_words}."
        lead += f" With that test it becomes {now[design.worst] / widths[design.worst]:.2g} times narrower."
    return Page("The next experiment", "Design by Fisher's information", headline, lead, best is not None, sections)


def _what(stored: Stored, design: Design) -> Section:
    parts: list[Part] = []
    if stored.case:
        parts += [Lines(case_words(stored.case)), tests_table(stored.case, "Tests of the case")]
    now = design.widths() or {}
    rows = tuple((name, number(value, 6), number(now.get(name), 3)) for name, value in design.parameters.items())
    header = ("Parameter", "Value", "Half width of the 95 % interval by the tests of the case")
    seen = "" if design.view_noise is None else f", of a displacement in a side view {quantity(design.view_noise, 'mm', 3)}"
    parts.append(Table(f"Where the information is taken; noise of a force {number(design.noise, 3)} mN{seen}", header, rows))
    return Section("what", "What was asked", tuple(parts))


def _tests(design: Design) -> Section:
    names = list(design.stderr)
    failed = any(test.cause for test in design.candidates)
    errors = [f"± {name}, 95 %" for name in names]
    header = ("Change", "Angle (°)", "Depth (mm)", *errors, "Solves", "Needs", *(["Cause"] if failed else []))
    rows = tuple(
        (
            test.words,
            "–" if test.angle is None else str(test.angle),
            number(test.depth, 3),
            *(number(widths[name] if (widths := design.widths(test)) else None, 3) for name in names),
            "–" if test.solves is None else str(test.solves),
            test.effort or "–",
            *([test.cause or "–"] if failed else []),
        )
        for test in design.candidates
    )
    parts: list[Part] = [Table(f"Further tests, the best for {design.worst} first", header, rows)]
    if any(test.stderr for test in design.candidates):
        caption = f"Half width of the 95 % interval of {design.worst} with each further test; the dashed line is without one."
        alt = f"Bars of the half width of the 95 % interval of {design.worst}. The numbers are in the table."
        parts.insert(0, Figures((drawn(plots.designs(design), caption, alt),)))
    if design.pairs:
        header = ("First", "Second", *errors, "Needs")
        pairs = tuple(
            (pair.first, pair.second, *(number((design.widths(pair) or {}).get(name), 3) for name in names), pair.effort or "–")
            for pair in design.pairs
        )
        parts.append(Table(f"Pairs of further tests, the best for {design.worst} first", header, pairs))
    parts.append(Lines(tuple(f"Note: {note}." for note in design_notes(design, design.candidates, design.pairs))))
    return Section("tests", "Further tests", tuple(parts))


def _command(stored: Stored, design: Design) -> str:
    """The command that gives the design again: with the noise, and the parameters where the case starts from others."""
    given = stored.case.material.parameters if stored.case else {}
    start = {name: value.start for name, value in given.items() if isinstance(value, Range)}
    at = dict(design.parameters)
    if stored.case and YOUNG in start and YOUNG not in at:  # the case's word for its shear modulus
        mu = next(value for name, value in at.items() if name not in given)
        at[YOUNG] = float(f"{2 * mu * (1 + stored.case.material.poisson_ratio_at(mu)):.10g}")
    moved = {name: at[name] for name in start if at[name] != start[name]}
    options = "".join(f" --set material.{name}.start={value!r}" for name, value in moved.items())
    seen = "" if design.view_noise is None else f" --view-noise {design.view_noise!r}"
    open_values = " --estimated" if design.between or design.unsolved else ""
    return f"design --noise {design.noise!r}{seen}{open_values}{options}"
