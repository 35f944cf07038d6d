"""Faults of two families of fibres: where a case lacks their angles, or has angles that do not go with its law."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from pydantic import ValidationError

from indentfit.arrays import Array
from indentfit.case.fibre_faults import faults_of_map, faults_of_turns
from indentfit.case.laws import families_of, fibres_in, has_fibres
from indentfit.case.messages import MISSING, Fault, Key
from indentfit.case.specimen import BondedDisc, specimen_of
from indentfit.case.tables import MaterialChoice, Sample, Test
from indentfit.errors import CaseError
from indentfit.fibre_map import FibreMap
from indentfit.fibres import Direction, directions
from indentfit.material import Material

PARALLEL, RIGHT = 1e-6, 1e-6  # of the cosine of the angle between two families
NEEDED = "missing; the material has two families of fibres: give the angle of each from the direction that {}, such as [40, -40]"


def faults_of_families(
    choice: MaterialChoice | None, law: type[Material] | None, sample: Sample | None, tests: Sequence[tuple[str, Test | None]]
) -> Iterator[Fault]:
    """Faults of the keys `families` and `family_dips`.

    Parameters
    ----------
    choice, law, sample : None where they have faults
    tests : sequence of (label, Test)
    """
    if law is None or choice is None:
        return
    indentations = [(label, test) for label, test in tests if test is None or test.kind in (None, "indentation")]
    places: list[tuple[Key, Sample | None]] = (
        [(("sample",), sample)] if any(not (test and test.sample) for _, test in indentations) else []
    )
    places += [(("test", label, "sample"), _over(test.sample, sample)) for label, test in indentations if test and test.sample]
    for place, table in places:
        if table is not None:
            yield from _of_sample(place, table, law)
            on_it = [(label, test) for label, test in indentations if test and bool(test.sample) == (place != ("sample",))]
            on_it = [pair for pair in on_it if place in (("sample",), ("test", pair[0], "sample"))]
            yield from _of_map(place, table, law, on_it)
            for label, own in on_it if has_fibres(law) else ():
                yield from _of_outlines(label, own, choice, law, table)
    for label, test in tests:
        if test is not None and test.kind in (None, "indentation"):
            yield from _of_dip(label, test, law)
        elif test is not None:
            yield from _of_specimen(label, test, choice, law)


def _over(own: Any, sample: Sample | None) -> Sample | None:
    """The sample of a test; None where it has faults of its own."""
    try:
        return own.over(sample) if sample is not None else None
    except (ValidationError, CaseError, TypeError):
        return None


def _of_outlines(label: str, test: Test, choice: MaterialChoice, law: type[Material], sample: Sample) -> Iterator[Fault]:
    """Faults of outlines in a plane that is no plane of symmetry: the solution leaves it, so that its section is no outline."""
    if test.angle is None or not any(field.outline for field in test.field):
        return
    try:
        kept = fibres_in(choice, law, sample, Direction(test.angle, test.dip)).kept
    except CaseError:
        return  # the fibres have faults of their own
    for field in test.field:
        if isinstance(field.file, str) or field.file.across is None:
            continue
        plane = "x" if field.file.across == 0 else "z"
        if kept not in ("quarter", f"mirror_{plane}"):
            text = (
                f"lies in the plane {plane} = 0, about which the fibres of the test are not symmetric; give material points instead"
            )
            yield Fault(("test", label, "field", field.label, "outline"), True, text)


def _of_sample(place: Key, sample: Sample, law: type[Material]) -> Iterator[Fault]:
    given = dict(sample)
    families, dips = given.get("families"), given.get("family_dips")
    if not law.two_families:
        for key, value in (("families", families), ("family_dips", dips)):
            if value is not None:
                yield Fault((*place, key), list(value), _one_family(law))
        return
    if families is None:
        if "families" not in sample.model_fields_set and sample.directions is None:
            yield Fault((*place, "families"), MISSING, NEEDED.format("test.angle states"))
        return
    a, b = directions(0.0, 0.0, families_of(law, sample))
    if text := _between(law, float(a @ b)):
        yield Fault((*place, "families"), list(families), text)


def _of_map(place: Key, sample: Sample, law: type[Material], tests: Sequence[tuple[str, Test]]) -> Iterator[Fault]:
    """Faults of directions on points, of a sample and the tests on it."""
    fibres, shape, key = sample.directions, sample.geometry_if_right(), (*place, "directions")
    if not isinstance(fibres, FibreMap) or shape is None:
        return
    faults = list(faults_of_map(key, fibres, shape.outline, float(sample.thickness), law, has_fibres(law)))
    yield from faults or faults_of_turns(key, fibres, shape.outline, tests, sample.prestretch is not None)


def _one_family(law: type[Material]) -> str:
    has = "one family of fibres" if has_fibres(law) else "no fibres"
    return f"the material has {has}; remove the key, or choose a law with two families (`indentfit materials` lists them)"


def _between(law: type[Material], cosine: float) -> str:
    """What is wrong with the angle between the families; empty where nothing is."""
    if abs(cosine) > 1 - PARALLEL:
        return "both families run in the same direction; give two directions, or a law with one family"
    if law.perpendicular and abs(cosine) > RIGHT:
        apart = np.degrees(np.arccos(abs(cosine)))
        return f"the energy of {law.__name__} holds for families at right angles, and these are {apart:.4g} degrees apart"
    return ""


def _of_dip(label: str, test: Test, law: type[Material]) -> Iterator[Fault]:
    if law.two_families and test.dip:
        yield Fault(("test", label, "dip"), test.dip, "two families of fibres have dips of their own: give sample.family_dips")


def _of_specimen(label: str, test: Test, choice: MaterialChoice, law: type[Material]) -> Iterator[Fault]:
    key: Key = ("test", label, "families")
    if not law.two_families:
        if test.families is not None:
            yield Fault(key, list(test.families), _one_family(law))
        return
    if test.families is None:
        if "families" not in test.model_fields_set:
            yield Fault(key, MISSING, NEEDED.format("test.fibres names"))
        return
    specimen = specimen_of(test)
    assert specimen is not None  # the test is no indentation
    if isinstance(specimen.state, BondedDisc):
        return  # `specimen.disagreements` has refused it
    a, b = specimen.state.directions
    text = _between(law, float(a @ b))
    if not text and test.kind != "shear" and not _keep_axes(choice, law, test.families, a, b):
        text = (
            "would shear the specimen under stretch; two families are solved where they run along the axes, or where they are "
            "mirror images with the same parameters, such as [30, -30]"
        )
    if text:
        yield Fault(key, list(test.families), text)


def _keep_axes(choice: MaterialChoice, law: type[Material], angles: tuple[float, float], a: Array, b: Array) -> bool:
    """Whether stretches along the axes cause no shear stress."""
    along = all(np.isclose(np.abs(fibre).max(), 1) for fibre in (a, b))
    plain = Sample.model_construct(families=angles, family_dips=None, fibre_angle=0.0)
    return bool(along or fibres_in(choice, law, plain, Direction(0.0)).kept == "quarter")
