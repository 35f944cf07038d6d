"""Faults of a case whose tables are each correct: parameters that the law does not have, and tables that contradict each other."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from pydantic import ValidationError

from indentfit.axes import INDENTATION, Axes
from indentfit.case.creep_faults import faults_of_creep
from indentfit.case.in_time import motion_of
from indentfit.case.laws import YOUNG, has_fibres, own_parameters, shear_parameter
from indentfit.case.layers import OF_LAYERS, faults_of_layers
from indentfit.case.materials import LayersChoice
from indentfit.case.messages import MISSING, Fault, Key, key_of, unknown, wording
from indentfit.case.prestretch import faults_of_prestretch
from indentfit.case.recording import Record
from indentfit.case.search import Fit
from indentfit.case.section import known
from indentfit.case.specimen import loading_of
from indentfit.case.tables import Indenter, MaterialChoice, Mesh, OwnTable, Range, Sample, Solver, Table, Test
from indentfit.curve import Curve, not_loading_only
from indentfit.digits import sizes
from indentfit.errors import MaterialError
from indentfit.indenters import IndenterShape, Rings
from indentfit.material import Material, blamed, laws_of, require_derivable, shipped
from indentfit.motion import Motion

DEEPEST_INDENTATION = 0.5  # of the thickness
SIZES = ("width", "diameter", "radius")  # keys of an indenter that are its size


@dataclass(frozen=True)
class Parts:
    """The parts of a case that could be read; None stands for a table, or a key, that has a fault."""

    title: str
    sample: Sample | None
    indenter: Indenter | None
    mesh: Mesh | None
    material: MaterialChoice | None
    fit: Fit | None
    solver: Solver | None
    record: Record | None
    tests: tuple[Test | None, ...] = ()
    curves: tuple[Curve | None, ...] = ()

    def with_tests(self, tests: Sequence[Test | None], curves: Sequence[Curve | None]) -> Parts:
        """These parts with tests and their curves."""
        return replace(self, tests=tuple(tests), curves=tuple(curves))

    @property
    def of_indentations(self) -> Parts:
        """These parts without tests that need no indenter."""
        if all(test is None or test.kind in (None, "indentation") for test in self.tests):
            return self
        pairs = zip(self.tests, self.curves, strict=True)
        kept = [(test, curve) for test, curve in pairs if test is None or test.kind in (None, "indentation")]
        return self.with_tests([test for test, _ in kept], [curve for _, curve in kept])


# Parameters


def faults_of_parameters(choice: MaterialChoice | None, law: type[Material] | None, table: Key = ("material",)) -> Iterator[Fault]:
    """Faults where the parameters are not those of the law, or outside its own bounds."""
    if choice is None or law is None or choice.parameters is None:
        return
    if isinstance(choice, LayersChoice):
        for layer in choice.layers:
            yield from faults_of_parameters(layer.choice, laws_of(law)[layer.name], (*OF_LAYERS, layer.name))
        return
    place: Key = (*table, "parameters")
    if faults := list(_faults_of_young(choice, law, place)):
        yield from faults
        return
    given = own_parameters(choice, law)
    relaxing = choice.relaxation.parameters if choice.relaxation is not None else {}
    for name in set(relaxing) & set(law.parameters):
        text = f"the relaxation has a parameter {name} too; rename that of the law"
        yield Fault((*place, name), plain(given.get(name, MISSING)), text)
    for name in given:
        if name in choice.shared:
            yield Fault(
                (*place, name), plain(given[name]), f"the families share it (shared = {[*choice.shared]}); remove one of the two"
            )
        elif name not in law.parameters:
            yield Fault((*place, name), plain(given[name]), unknown(name, _words_of(law), "parameter"))
    for name, parameter in law.parameters.items():
        if name in given:
            yield from _outside_of_the_law(place, name, given[name], parameter)
            continue
        unit = f", {parameter.unit}" if parameter.unit not in ("", "1") else ""
        yield Fault((*place, name), MISSING, f"missing; give a number, or {{start, min, max}}: {parameter.meaning}{unit}")


def _words_of(law: type[Material]) -> list[str]:
    """The names that the parameters of a law can have in a case."""
    return [*law.parameters, *([YOUNG] if shear_parameter(law) else [])]


def _faults_of_young(choice: MaterialChoice, law: type[Material], place: Key) -> Iterator[Fault]:
    """Young's modulus beside the shear modulus, or too large for the bulk modulus."""
    young, name = choice.parameters.get(YOUNG), shear_parameter(law)
    if young is None or name is None or YOUNG in law.parameters:
        return
    if name in choice.parameters:
        yield Fault((*place, YOUNG), plain(young), f"{name} is given too; keep one of them")
    numbers = (young.min, young.start, young.max) if isinstance(young, Range) else (young,)
    if choice.kappa is not None and max(numbers) >= 9 * choice.kappa:
        text = f"must stay below 9 kappa = {9 * choice.kappa:g} kPa; raise material.kappa, or give poisson_ratio in its place"
        yield Fault((*place, YOUNG), plain(young), text)


def _outside_of_the_law(place: Key, name: str, value: float | Range, parameter: Any) -> Iterator[Fault]:
    """Faults where a parameter, or a bound of its search, is outside the law's own bounds."""
    numbers = {"min": value.min, "max": value.max} if isinstance(value, Range) else {"": value}
    for key, number in numbers.items():
        where = (*place, name, key) if key else (*place, name)
        if parameter.min is not None and number < parameter.min:
            yield Fault(where, number, f"the model needs at least {parameter.min:g}; raise it")
        if parameter.max is not None and number > parameter.max:
            yield Fault(where, number, f"the model needs at most {parameter.max:g}; lower it")


def faults_of_stiffness(choice: MaterialChoice, law: type[Material], table: Key = ("material",)) -> Iterator[Fault]:
    """A fault where the material has no positive stiffness at the start values."""
    if isinstance(choice, LayersChoice):
        for layer in choice.layers:
            yield from faults_of_stiffness(layer.choice, laws_of(law)[layer.name], (*OF_LAYERS, layer.name))
        return
    try:
        with np.errstate(all="ignore"), blamed(law):
            if not shipped(law):
                require_derivable(law)  # a fault of a lab's own law is reported here, before any solve
            moduli = law(**start_values(choice, law)).moduli()
        wrong = "" if all(map(math.isfinite, moduli.values())) else "the material has no finite stiffness"
    except ArithmeticError:
        wrong = "the material has no finite stiffness"
    except MaterialError as error:
        wrong = str(error)
    if wrong:
        yield Fault((*table, "parameters"), MISSING, f"{wrong}; change the start values")


def start_values(choice: MaterialChoice, law: type[Material]) -> dict[str, float]:
    """Every parameter in the order of the law: its fixed number, or the start of its search."""
    given = own_parameters(choice, law)
    values = {name: given[name] for name in law.parameters}
    return {name: value.start if isinstance(value, Range) else value for name, value in values.items()}


def plain(value: Any) -> Any:
    """A range as a table of numbers; any other value unchanged."""
    return value.model_dump() if isinstance(value, Range) else value


def faults_of_fibres(choice: MaterialChoice | None, law: type[Material] | None, tests: Sequence[Test | None]) -> Iterator[Fault]:
    """Faults where a material with fibres lacks what only fibres need, or has what only materials without fibres can have."""
    if law is None or not has_fibres(law):
        return
    for label, test in zip(labels([test and test.name for test in tests]), tests, strict=True):
        key = "angle" if test is None or test.kind in (None, "indentation") else "fibres"
        if test is not None and getattr(test, key) is None and key not in test.model_fields_set:
            yield Fault(("test", label, key), MISSING, f"missing; the material has fibres: {NEEDED[key]}")
    text = "the material has fibres, and no single Poisson's ratio; give bulk_ratio or kappa in its place"
    if isinstance(choice, LayersChoice):
        for layer in choice.layers:
            if layer.poisson_ratio is not None and has_fibres(laws_of(law)[layer.name]):
                yield Fault((*OF_LAYERS, layer.name, "poisson_ratio"), layer.poisson_ratio, text.replace(" or kappa", ""))
    elif choice is not None and choice.poisson_ratio is not None:
        yield Fault(("material", "poisson_ratio"), choice.poisson_ratio, text)


def faults_of_turn(fit: Fit | None, law: type[Material] | None) -> Iterator[Fault]:
    """A fault where the angle of fibres is to be fitted, of a material without fibres."""
    if fit is None or fit.uncertain is None or law is None or has_fibres(law):
        return
    if (angle := fit.uncertain.fibre_angle) is not None:
        yield Fault(("fit", "uncertain", "fibre_angle"), plain(angle), "the material has no fibres; remove it")


NEEDED = {
    "angle": "give their angle from x, the indenter's long side, in degrees: 0 along it, 90 across it",
    "fibres": "give their direction: along the load, across it, or normal to the plane of shear or of two stretches",
}


# Tables that do not agree


def faults_of_absence(parts: Parts, given: Collection[str]) -> list[Fault]:
    """Faults where an indentation lacks the table of its sample or indenter, or where there are tables that no test asks for."""
    asked = any(test is None or test.kind in (None, "indentation") for test in parts.tests)
    if asked:
        return [Fault((name,), MISSING, f"missing; add a table [{name}]") for name in ("sample", "indenter") if name not in given]
    text = "no test is an indentation, and other tests need no such table; remove it"
    return [Fault((name,), MISSING, text) for name in ("sample", "indenter") if name in given]


def _faults_of_specimen(label: str, test: Test, curve: Curve | None, material: MaterialChoice | None) -> Iterator[Fault]:
    """Faults of a test without an indenter, or of a curve that is not that of such a test."""
    if curve is not None and curve.axes is not None:
        yield from _faults_of_axes(label, test, curve, curve.axes)
    if test.kind == "indentation":
        return
    if material is not None and material.relaxation is not None:
        text = "is not solved for a material that relaxes; remove [material.relaxation], or give an indentation"
        yield Fault(("test", label, "kind"), test.kind, text)
    if curve is not None and loading_of(test) == "compression" and curve.deepest >= (test.length or 1.0):
        text = f"goes to a strain of {curve.deepest / (test.length or 1.0):.4g} in compression; the stretch must stay above 0"
        yield Fault(("test", label, "curve"), test.curve, text)


def _faults_of_axes(label: str, test: Test, curve: Curve, axes: Axes) -> Iterator[Fault]:
    """Faults where a curve shows other quantities than those that its test's keys mean."""
    if test.kind == "indentation":
        if axes != INDENTATION:
            text = f"shows {axes.across} and {axes.up}; an indentation needs displacement and force (or give test.kind)"
            yield Fault(("test", label, "curve"), test.curve, text)
        return
    if test.kind == "compression":
        if axes != INDENTATION:
            text = f"shows {axes.across} and {axes.up}; a compression between plates needs displacement and force"
            yield Fault(("test", label, "curve"), test.curve, text)
        return
    for key, shown, absolute in (("length", axes.across, "displacement"), ("area", axes.up, "force")):
        value = getattr(test, key)
        if shown == absolute and value is None:
            text = f"missing; the curve shows {absolute}s: give the {key} of the specimen"
            yield Fault(("test", label, key), MISSING, text)
        if shown != absolute and value is not None:
            plural = "stresses" if shown == "stress" else "strains"
            yield Fault(("test", label, key), value, f"has no effect: the curve shows {plural}, not {absolute}s; remove it")


def faults_across(parts: Parts) -> Iterator[Fault]:
    """Faults between tables that are each correct."""
    yield from _equal_names(parts.tests)
    yield from faults_of_layers(parts)
    yield from faults_of_prestretch(parts)
    for label, test, curve in zip(labels([test and test.name for test in parts.tests]), parts.tests, parts.curves, strict=True):
        if test is not None and test.kind is not None:
            yield from _faults_of_specimen(label, test, curve, parts.material)
    parts = parts.of_indentations
    if parts.tests:
        yield from _faults_of_indentations(parts)
    if parts.sample is not None:
        yield from _faults_of_uncertain(parts)


def _faults_of_indentations(parts: Parts) -> Iterator[Fault]:
    yield from _faults_of_time(parts)
    places, faults = _places_of_tests(parts)
    yield from faults
    for place in places:
        yield from _faults_of_place(place, parts.mesh)


@dataclass
class _Place:
    """A sample and an indenter, with the tests on them: name, Test and depth."""

    sample: Sample | None
    indenter: Indenter | None
    tests: list[tuple[str, Test | None, float | None]]


def _places_of_tests(parts: Parts) -> tuple[list[_Place], list[Fault]]:
    """The different samples and indenters of the tests, the case's own first; and the faults of tables of tests."""
    places, faults = [_Place(parts.sample, parts.indenter, [])], list[Fault]()
    names = labels([test and test.name for test in parts.tests])
    for label, test, curve in zip(names, parts.tests, parts.curves, strict=True):
        sample = own_table(parts.sample, test.sample if test else None, ("test", label, "sample"), faults)
        indenter = own_table(parts.indenter, test.indenter if test else None, ("test", label, "indenter"), faults)
        place = next((place for place in places if (place.sample, place.indenter) == (sample, indenter)), None)
        if place is None:
            places.append(place := _Place(sample, indenter, []))
        place.tests.append((label, test, depth_of(test, curve)))
    return [place for place in places if place.tests or len(places) == 1], faults


def own_table(table: Table | None, own: OwnTable | None, place: Key = (), faults: list[Fault] | None = None) -> Table | None:
    """The table of a test; None where the case's table is not right, or the test's keys do not go with it, of which there is then
    a fault."""
    if table is None or own is None:
        return table
    if any(dict(table).get(name) is None for name, field in type(table).model_fields.items() if field.is_required()):
        return None
    try:
        return own.over(table)
    except ValidationError as error:
        for flaw in error.errors(include_url=False) if faults is not None else ():
            key = key_of(flaw)
            value = getattr(own, str(key[-1]), None)
            assert faults is not None
            faults.append(Fault((*place, *key), MISSING if value is None else value, wording(type(table), flaw)))
        return None


def _faults_of_place(place: _Place, mesh: Mesh | None) -> Iterator[Fault]:
    if place.sample is None:
        return
    thickness, depths = place.sample.thickness, [depth for _, _, depth in place.tests if depth]
    if known(thickness):
        yield from _too_deep(thickness, place.tests)
        yield from _mesh_too_coarse(thickness, mesh)
    if place.indenter is not None:
        yield from _indenter_too_wide(place, max(depths, default=0.0))


def _faults_of_time(parts: Parts) -> Iterator[Fault]:
    """Faults where a material relaxes in a test without times, or a test has times that no material asks for."""
    if parts.material is None:
        return
    relaxes = parts.material.relaxation is not None
    names = labels([test and test.name for test in parts.tests])
    for label, test, curve in zip(names, parts.tests, parts.curves, strict=True):
        if test is None:
            continue
        given = [key for key in ("rate", "ramp", "hold", "force") if getattr(test, key) is not None]
        creep = list(faults_of_creep(label, test, curve))
        if creep:
            yield from creep
        elif not relaxes:
            yield from _faults_of_no_time(label, test, curve, given)
        elif curve is not None and curve.time is not None:
            yield from _faults_of_motion(parts, label, test, curve, given)
        elif not {"rate", "ramp"} & {*given, *(test.model_fields_set & {"rate", "ramp"})} and (curve is not None or test.depth):
            text = "missing; the material relaxes: give the velocity in the ramp (rate, mm/s) or the duration of the ramp (ramp, s)"
            if curve is not None:
                text += ", or a column time_s in the file of the curve"
            yield Fault(("test", label, "rate"), MISSING, text)


def _faults_of_no_time(label: str, test: Test, curve: Curve | None, given: list[str]) -> Iterator[Fault]:
    """Faults of a test that has times, where the material is elastic."""
    if given:
        text = "has no effect without a table [material.relaxation]; add the table, or remove this key"
        yield Fault(("test", label, given[0]), getattr(test, given[0]), text)
    if curve is not None and (wrong := not_loading_only(curve)):
        key = "record" if test.record else "curve"
        text = f"{wrong}; or add a table [material.relaxation], with which the hold is fitted too"
        yield Fault(("test", label, key), getattr(test, key), text)


def _faults_of_motion(parts: Parts, label: str, test: Test, curve: Curve, given: list[str]) -> Iterator[Fault]:
    """Faults of a test whose curve has times, where the material relaxes."""
    key = "record" if test.record else "curve"
    known = motion_of(test, curve)
    assert known is not None  # the curve has times
    motion, _ = known
    if given:
        yield Fault(("test", label, given[0]), getattr(test, given[0]), f"the times of the {key} tell it; remove this key")
    if motion.reverses:
        text = "the indenter goes back and ahead again; only one ramp with its hold and retraction can be fitted: cut the record"
        yield Fault(("test", label, key), getattr(test, key), text)
    indenter = own_table(parts.indenter, test.indenter)
    shape = indenter.geometry_if_right() if indenter is not None else None
    if motion.retracts and indenter is not None and shape is not None and (why := _not_in_retraction(indenter, shape)):
        yield Fault(("test", label, key), getattr(test, key), f"{why}; end the curve at {_turning(motion, curve):.4g} s")


def _not_in_retraction(indenter: Indenter, shape: IndenterShape) -> str:
    """Why the force in a retraction of an indenter is not known; empty where it is."""
    if shape.edge_radius is None and not isinstance(shape.partition(0.0), Rings):
        return f"the indenter goes back, and under a {shape.name} the contact shrinks in a way for which no rule is known here"
    if shape.edge_radius is None and indenter.friction != 0:
        return f"the indenter goes back, and Ting's rule for a {shape.name} needs indenter.friction = 0"
    if indenter.friction not in (0, "stick"):
        return "the indenter goes back, and slip under friction reverses then; indenter.friction may be 0 or stick"
    return ""


def _turning(motion: Motion, curve: Curve) -> float:
    """The time of a curve at which its indenter begins to go back, s."""
    assert curve.time is not None
    return float(motion.time[motion.turn] - motion.time[-1] + curve.time[-1])


def labels(names: Sequence[object]) -> list[str]:
    """The name of each test in messages: its own name, or its number where the name is missing or given twice."""
    return [name if isinstance(name, str) and name and names.count(name) == 1 else str(n) for n, name in enumerate(names)]


def depth_of(test: Test | None, curve: Curve | None) -> float | None:
    """The largest displacement of a test, mm; None where it is not known."""
    if curve is not None:
        return curve.deepest
    return test.largest if test is not None else None


def _equal_names(tests: Sequence[Test | None]) -> Iterator[Fault]:
    names = [test and test.name for test in tests]
    for n, name in enumerate(names):
        if name is not None and name in names[:n]:
            yield Fault(("test", str(n), "name"), name, "another test has this name; give each its own")


def _too_deep(thickness: float, tests: Sequence[tuple[str, Test | None, float | None]]) -> Iterator[Fault]:
    for label, test, depth in tests:
        if test is None or depth is None or depth <= DEEPEST_INDENTATION * thickness * (1 + 1e-9):
            continue
        key = "depth" if test.depth is not None else "curve"
        text = f"goes {sizes(depth)} deep; it must not exceed half of the thickness, {sizes(thickness)}"
        if depth >= thickness:
            text = f"goes {sizes(depth)} deep, through the sample of {sizes(thickness)}: its unit or sample.thickness is wrong"
        yield Fault(("test", label, key), getattr(test, key), text)


def _mesh_too_coarse(thickness: float, mesh: Mesh | None) -> Iterator[Fault]:
    if mesh is not None and mesh.size is not None and mesh.size > thickness:
        yield Fault(("mesh", "size"), mesh.size, f"exceeds the thickness of {sizes(thickness)}; make it smaller")


OF_TABLES = {
    "friction": ("indenter", "friction"),
    "thickness": ("sample", "thickness"),
    "base": ("sample", "base"),
    "fibre_angle": ("sample", "fibre_angle"),
}


def _has_own(parts: Parts, test: Test | None, table: str, key: str) -> bool:
    """Whether a test has its own value of a key of a table."""
    own, common = getattr(test, table, None), getattr(parts, table)
    return own is not None and common is not None and own.replaces(key, common)


def _faults_of_uncertain(parts: Parts) -> Iterator[Fault]:
    """Faults where an input stated as uncertain does not exist in this case."""
    indenter, material = parts.indenter, parts.material
    if parts.fit is None or parts.fit.uncertain is None:
        return
    uncertain = parts.fit.uncertain
    if not parts.tests:
        for name in ("friction", "thickness", "base", "offset", "fibre_angle"):
            if getattr(uncertain, name) is not None:
                text = "no test is an indentation, and other tests do not depend on it; remove it"
                yield Fault(("fit", "uncertain", name), plain(getattr(uncertain, name)), text)
        indenter = None
    if uncertain.size is not None and indenter is not None and all(getattr(indenter, key, None) is None for key in SIZES):
        text = f"the {indenter.shape} has no width or diameter that could be uncertain; remove it, or give the shaft's"
        yield Fault(("fit", "uncertain", "size"), plain(uncertain.size), text)
    if uncertain.friction is not None and indenter is not None and indenter.friction == "stick":
        text = "the indenter sticks; give indenter.friction a number"
        yield Fault(("fit", "uncertain", "friction"), plain(uncertain.friction), text)
    for name, (table, key) in OF_TABLES.items():
        some = any if name == "fibre_angle" else all  # a run's derivatives by this angle turn the fibres of every test
        if getattr(uncertain, name) is not None and parts.tests and some(_has_own(parts, test, table, key) for test in parts.tests):
            text = (
                f"{'a' if some is any else 'every'} test has its own {key}, which no fit takes for uncertain; give it in [{table}]"
            )
            yield Fault(("fit", "uncertain", name), plain(getattr(uncertain, name)), text)
    given = material and next((key for key in ("kappa", "poisson_ratio") if getattr(material, key) is not None), None)
    if uncertain.bulk_ratio is not None and given:
        text = f"material.{given} is given; give material.bulk_ratio instead"
        yield Fault(("fit", "uncertain", "bulk_ratio"), plain(uncertain.bulk_ratio), text)


def _indenter_too_wide(place: _Place, depth: float) -> Iterator[Fault]:
    sample, indenter = place.sample, place.indenter
    assert sample is not None and indenter is not None
    geometry, shape = sample.geometry_if_right(), indenter.geometry_if_right()
    of_test: Key = next((("test", label) for label, test, _ in place.tests if test and test.indenter), ())
    if geometry is not None and shape is not None:
        for key, text in shape.faults_on(sample.stretched.geometry.outline.extent, depth):
            key = indenter.word_for(key)
            yield Fault((*of_test, "indenter", key), getattr(indenter, key), text)


def faults_of_fit(free: Mapping[str, Range], tests: Sequence[Test], curves: Sequence[Curve | None]) -> Iterator[Fault]:
    """Faults of a case that can be simulated but not fitted."""
    yield from faults_of_freedom(free)
    for test, curve in zip(tests, curves, strict=True):
        if curve is None:
            yield Fault(("test", test.name, "curve"), MISSING, "missing; a fit needs a measured curve")
    if not sum(test.weight or 0.0 for test in tests):
        yield Fault(("test",), MISSING, "every weight is 0; give at least one test a weight")


def faults_of_freedom(free: Mapping[str, Range]) -> Iterator[Fault]:
    """The fault of a case that leaves no parameter free."""
    if not free:
        text = "no parameter is free; give at least one as {start = ..., min = ..., max = ...}"
        yield Fault(("material", "parameters"), MISSING, text)
