"""Warnings about values of a case that are allowed but unusual."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from indentfit.case.doubts import doubts
from indentfit.case.draining import draining
from indentfit.case.faults import depth_of
from indentfit.case.laws import has_fibres
from indentfit.case.materials import DEFAULT_BULK_RATIO, LayersChoice
from indentfit.case.unknown import IGNORANCE
from indentfit.digits import quantity
from indentfit.errors import MaterialError
from indentfit.indenters import Rings
from indentfit.material import Material, parts_of

if TYPE_CHECKING:
    from indentfit.case.tables import MaterialChoice, Test
    from indentfit.case.whole import Case

MOST_CORNERS = 5  # free parameters whose bounds are combined to look for an unstable material
NEARLY_INCOMPRESSIBLE = 10  # bulk modulus over the largest small-strain modulus
COMPRESSIBLE = 10.0  # bulk over shear modulus below which an isotropic sample is meant to be compressible (Poisson's ratio 0.45)
# Of the thickness, under bars and under round indenters on samples with fibres: beyond it equilibrium may not be found. Without
# fibres 75 of 76 round contacts are solved between 40 and 50 % (tests/campaigns/round.py), as many as above.
DEEP, DEEP_ROUND = 0.2, 0.4
UNHEARD = 10.0  # times that one test counts as much as another in equation (1), from which on the other is hardly heard
SUNK = 5.0  # depth over the half-width of an indenter, beyond which a unit or a diameter is more likely to be wrong


def warnings_of(case: Case) -> Iterator[str]:
    """One line for each allowed but unusual value of a case."""
    yield from _unstable(case)
    yield from _compressible(case)
    yield from _unknown(case)
    yield from _mirrored(case)
    for test, curve in zip(case.tests, case.curves, strict=True):
        yield from (f"test.{test.name}: {note}" for note in (curve.notes if curve else ()))
        if test.kind != "indentation":
            continue
        deep = _deep(case, test)
        depth, thickness = depth_of(test, curve) or 0.0, case.sample_of(test).thickness
        if depth > deep * thickness * (1 + 1e-9):
            share = depth / thickness
            yield f"test.{test.name} goes to {share:.0%} of the thickness; beyond {deep * 100:g} % equilibrium may not be found"
        if sunk := _sunk(case, test, depth):
            yield f"test.{test.name} {sunk}"
        if curve is not None:
            yield from map(str, doubts(test.name, curve.loading, test.record is not None))
    yield from draining(case)
    yield from _unheard(case)
    if len(case.free) > 1 and has_fibres(case.law) and len({_direction(case, test) for test in case.tests}) == 1:
        if case.tests[0].kind != "indentation":
            yield f"every test is {case.tests[0].kind} {case.tests[0].fibres} the fibres: this cannot distinguish the fibre terms"
            return
        yield f"every test has angle {case.tests[0].angle}: curves of one direction cannot distinguish the fibre terms"


def _deep(case: Case, test: Test) -> float:
    """The depth, over the thickness, beyond which equilibrium may not be found."""
    if not isinstance(case.indenter_of(test).geometry.partition(0.0), Rings):
        return DEEP
    return DEEP_ROUND if has_fibres(case.law) else np.inf


def _sunk(case: Case, test: Test, depth: float) -> str:
    """That an indenter sinks in by many times its half-width; empty for cones and wedges, which grow with the depth."""
    shape = case.indenter_of(test).geometry
    if shape.end == "cone" or depth <= SUNK * shape.half_width * (1 + 1e-9):
        return ""
    share = depth / shape.half_width
    return (
        f"goes {depth:.4g} mm deep, {share:.3g} times the half-width of the {shape.name}, {shape.half_width:.4g} mm; check the "
        "units of its size and of the depth"
    )


def _unheard(case: Case) -> Iterator[str]:
    """A warning where forces are so small beside others that equation (1), which adds up errors in mN, hardly hears their test.
    Fits over uncertain inputs, and curves with standard deviations, go by the noise of each test and not by equation (1)."""
    pairs = zip(case.tests, case.curves, strict=True)
    curves = [(test, curve) for test, curve in pairs if test.kind == "indentation" and curve is not None and test.weight]
    by_noise = any(name != "mesh" for name in case.fit.uncertain.given) or case.fit.discrepancy.stated is not None
    if not case.free or by_noise or any(curve.sd is not None for _, curve in curves):
        return
    largest = {test.name: float(np.abs(curve.force).max()) for test, curve in curves}
    counts = {test.name: (test.weight or 0.0) * largest[test.name] for test, _ in curves}
    least, most = min(counts, key=counts.__getitem__, default=""), max(counts, key=counts.__getitem__, default="")
    if counts and counts[most] > UNHEARD * counts[least] > 0:
        even = {name: 1 / force for name, force in largest.items()}
        weights = ", ".join(f"test.{name}.weight = {share / sum(even.values()):.3g}" for name, share in even.items())
        forces = f"its largest force is {quantity(largest[least], 'mN', 3)}, that of {most} {quantity(largest[most], 'mN', 3)}"
        yield f"test.{least} hardly counts in equation (1), which adds up errors in mN: {forces}; {weights} let all count alike"


def _direction(case: Case, test: Test) -> tuple[object, ...]:
    """What decides which fibre terms a test feels."""
    stretch = case.sample_of(test).prestretch if test.kind == "indentation" else None
    return test.angle, test.kind, test.fibres, stretch


def _mirrored(case: Case) -> Iterator[str]:
    """A warning where the angle of the fibres is fitted to tests that cannot tell it from its mirror image: a force is the same at
    opposite angles between fibres and indenter, and those of these tests change places when the fibres turn the other way."""
    places = {test.direction % 90 for test in case.indentations}
    if "fibre_angle" in case.fit.uncertain.fitted and len(places) == 1:
        (place,) = places
        other = f"{place:g} and {place + 90:g} degrees"
        yield (
            f"fit.uncertain.fibre_angle is fitted to tests at {other} only, or at one of them: an angle and its opposite fit "
            "equally well; add a test between them"
        )


def _compressible(case: Case) -> Iterator[str]:
    """A warning where the bulk modulus is not far above every small-strain modulus, and neither Poisson's ratio nor a bulk ratio
    that is clearly one of a compressible sample says that this is meant."""
    material = case.law(**case.start_values())
    if isinstance(case.material, LayersChoice):
        for layer, part in zip(case.material.layers, parts_of(material), strict=True):
            yield from _compressible_material(layer.choice, part, f"sample.layer.{layer.name}")
        return
    yield from _compressible_material(case.material, material, "material")


def _compressible_material(choice: MaterialChoice, material: Material, place: str) -> Iterator[str]:
    law = type(material)
    if choice.poisson_ratio is not None or (choice.kappa is None and not has_fibres(law) and _compressible_ratio(choice)):
        return
    stiffest = max(material.moduli().values())
    kappa = choice.bulk_modulus(material.shear_modulus)
    if kappa < NEARLY_INCOMPRESSIBLE * stiffest:
        key, nu = "kappa" if choice.kappa is not None else "bulk_ratio", choice.poisson_ratio_at(material.shear_modulus)
        meant = "unless this is intended"
        if not has_fibres(law) and nu >= 0:
            meant = f"or say that this is intended: {place}.poisson_ratio = {nu:.4g} in place of {key}"
        yield (
            f"kappa = {kappa:g} kPa is below {NEARLY_INCOMPRESSIBLE} x the largest small-strain modulus ({stiffest:g} kPa) at the "
            f"start values: the tissue is not nearly incompressible; raise {place}.{key} {meant}"
        )


def _compressible_ratio(choice: MaterialChoice) -> bool:
    return choice.bulk_over_shear is not None and choice.bulk_over_shear < COMPRESSIBLE


def _unknown(case: Case) -> Iterator[str]:
    """A warning for each input with a wide prior, at whose own value single runs are made."""
    for known in IGNORANCE:
        stated = getattr(case.fit.uncertain, known.name)
        if stated == known.prior:
            value = getattr(getattr(case, known.table), known.key)
            taken = value if isinstance(value, str) else f"{value:g}"
            key = f"{known.table}.{known.key}"
            yield f"{key} is unknown or left out: a fit goes over {known.words}, a simulation takes {taken}; give it if it is known"
    layers = [layer.name for layer in case.sample.layer if layer.bulk_ratio is None and layer.poisson_ratio is None]
    if len(layers) < len(case.sample.layer):
        for name in layers:
            yield f"sample.layer.{name}.bulk_ratio is left out: {DEFAULT_BULK_RATIO:g} is taken as known; give it"


def _unstable(case: Case) -> Iterator[str]:
    """A warning where the small-strain moduli are not positive, at the start values or at a corner of the bounds."""
    free = list(case.free.items())[:MOST_CORNERS]
    corners = itertools.product(*((bounds.start, bounds.min, bounds.max) for _, bounds in free))
    law, start = case.law, case.start_values()
    for values in itertools.islice(corners, 3**MOST_CORNERS):
        at = start | dict(zip((name for name, _ in free), values, strict=True))
        with contextlib.suppress(MaterialError), np.errstate(all="ignore"):
            if wrong := law(**at).unstable:
                where = ", ".join(f"{name} = {value:g}" for name, value in at.items())
                yield f"material.parameters: not stable at small strain at {where} ({wrong}); change the values or the bounds"
                return
