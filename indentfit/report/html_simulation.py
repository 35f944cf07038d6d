"""The page of a simulation."""

from collections.abc import Iterator, Mapping, Sequence

from indentfit.curve import Curve
from indentfit.fem.result import TimeCurve
from indentfit.inference.moduli import UNITS
from indentfit.report import plots
from indentfit.report.digits import CurveScale, end_words
from indentfit.report.html_case import again_section, case_words, number, percent, tests_table
from indentfit.report.html_facts import closed_table, facts_table, stress_sections
from indentfit.report.page import Figures, Lines, Page, Part, Section, Table, drawn
from indentfit.report.schema import SimulatedTest, Stored, StoredSimulation
from indentfit.report.text import time_lines
from indentfit.report.time_curves import depth_over_time, force_over_time

FORCES = ("Test", "Angle (°)", "Penalty error")


def simulation_page(stored: Stored, simulation: StoredSimulation) -> Page:
    """Page of a simulation's result folder."""
    facts = facts_table("Mesh and solver", {**simulation.mesh.as_json(), **simulation.solver.as_json()})
    sections = [
        _what(stored, simulation),
        _forces(stored, simulation),
        *_in_time(simulation),
        *stress_sections(stored.folder),
        Section("solver", "Mesh and solver", (facts,)),
        again_section(stored, "simulate"),
    ]
    ends = "; ".join(f"{test.name}: {_end(test.curve)}" for test in simulation.tests)
    return Page(simulation.title or "Simulation", "Finite-element simulation", "Computed.", f"{ends}.", True, tuple(sections))


def _what(stored: Stored, simulation: StoredSimulation) -> Section:
    parts: list[Part] = [Lines(case_words(stored.case)), tests_table(stored.case, "Tests")] if stored.case else []
    units = UNITS | (stored.case.units if stored.case else {})
    known = simulation.parameters | {name: value for name, value in simulation.moduli.items() if name not in simulation.parameters}
    rows = tuple((name, number(value, 6), "–" if units.get(name, "1") == "1" else units[name]) for name, value in known.items())
    parts += [Table("Parameters of the material", ("Parameter", "Value", "Unit"), rows), *closed_table(simulation.closed_forms)]
    return Section("what", "What was computed", tuple(parts))


def _forces(stored: Stored, simulation: StoredSimulation) -> Section:
    curves = [(test.name, test.curve) for test in simulation.tests]
    figure = plots.force_displacement(list(simulation.measured.items()), curves, None, stored.synthetic)
    parts: list[Part] = []
    for axes in dict.fromkeys(curve.shown for _, curve in curves):
        tests = [test for test in simulation.tests if test.curve.shown == axes]
        parts.append(_table(tests, CurveScale.of(test.curve for test in tests)))
    caption = "Force of the full sample against displacement." if len(parts) == 1 else "Curves of the tests."
    measured = (
        f" Markers: the {'synthetic' if stored.synthetic else 'measured'} curves that the case names."
        if simulation.measured
        else ""
    )
    pictures = Figures((drawn(figure, f"{caption}{measured}", _alt(curves)),))
    off = tuple(
        f"{name}: the simulation misses the measured {_up(simulation, name)} by {percent(share)}"
        for name, share in simulation.misfits.items()
    )
    lines = [Lines(tuple(f"{line} of the largest one (root mean square)" for line in off))] if off else []
    return Section("forces", "Forces", (pictures, *lines, *parts))


def _up(simulation: StoredSimulation, name: str) -> str:
    """What a test measures, in the plural."""
    stressed = any(test.name == name and test.curve.shown.up == "stress" for test in simulation.tests)
    return "stresses" if stressed else "forces"


def _table(tests: Sequence[SimulatedTest], scale: CurveScale) -> Table:
    """The last points of tests whose curves show the same quantities."""
    rows = tuple(
        (
            test.name,
            test.direction,
            scale.force.text(float(test.curve.force[-1])),
            scale.displacement.text(float(test.curve.displacement[-1])),
            percent(test.facts.penalty_error) if test.kind == "indentation" else "–",
        )
        for test in tests
    )
    if all(test.kind == "indentation" for test in tests):
        return Table("Forces at the last displacement", (*FORCES[:2], scale.up, scale.across, FORCES[2]), rows)
    return Table(f"Last {scale.axes.up} of each test", ("Test", "Fibres", scale.up, scale.across, FORCES[2]), rows)


def _in_time(simulation: StoredSimulation) -> Iterator[Section]:
    """Forces over time, where the material relaxes."""
    known = {test.name: test.in_time for test in simulation.tests if test.in_time is not None}
    pressed = {name: curve for name, curve in known.items() if not curve.creeps}
    if pressed:
        lines = _lines_in_time(pressed)
        figure = drawn(force_over_time(pressed, None), "Force of the full sample against time since contact.", "; ".join(lines))
        yield Section("time", "Forces over time", (Figures((figure,)), Lines(lines)))
    if creep := {name: curve for name, curve in known.items() if curve.creeps}:
        lines = _lines_in_time(creep)
        text = "Displacement against time since contact, under a force that rises and is then held."
        figure = drawn(depth_over_time(creep, None), text, "; ".join(lines))
        yield Section("creep", "Creep", (Figures((figure,)), Lines(lines)))


def _lines_in_time(curves: Mapping[str, TimeCurve]) -> tuple[str, ...]:
    return tuple(line.strip() for name, curve in curves.items() for line in time_lines(name, curve))


def _end(curve: Curve) -> str:
    return end_words(curve)


def _alt(curves: list[tuple[str, Curve]]) -> str:
    ends = "; ".join(f"{name} rises to {_end(curve)}" for name, curve in curves)
    return f"Force against displacement: {ends}"
