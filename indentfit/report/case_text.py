"""A case in words and as JSON, as `indentfit validate` prints it."""

from collections.abc import Iterator, Mapping
from typing import Any

from indentfit.case import Case, MaterialChoice, Mesh, Range
from indentfit.case.in_time import ramps_of
from indentfit.case.laws import YOUNG, has_fibres, kept_by, own_parameters
from indentfit.case.priors import Prior
from indentfit.case.specimen import axes_of
from indentfit.case.tables import Indenter, Sample, Test
from indentfit.digits import quantity, sizes
from indentfit.fibres import PART_WORDS, part_for
from indentfit.material import Layered, Material

SAYS_POISSON = 50.0  # bulk over shear modulus up to which Poisson's ratio, 0.49, tells more


def case_facts(case: Case) -> dict[str, Any]:
    """The case as JSON holds it."""
    sections = case.model_dump(mode="json", exclude={"path", "overrides", "curves", "tests"})
    tests = [{**test.model_dump(mode="json"), "n": case.points(test)} for test in case.tests]
    free = [*case.free, *(case.relaxation.free if case.relaxation else {})]
    return {
        "hash": case.hash,
        **sections,
        "tests": tests,
        "free": free,
        "warnings": case.warnings(),
    }


def case_lines(case: Case) -> Iterator[str]:
    """The case in words, line by line."""
    sample, indenter = case.sample, case.indenter
    yield f"{case.path}: valid" + (f", {case.title}" if case.title else "")
    if case.indentations:
        yield f"  sample    {sample_words(sample)}"
        yield f"  indenter  {indenter_words(indenter)}"
        yield f"  mesh      {_mesh(case.mesh)}"
    law = case.law
    for layer in case.sample.layer:
        bulk = _bulk(layer.choice, has_fibres(law))
        yield f"  layer     {layer.name}, {sizes(layer.thickness)}: {layer.model or layer.energy}, {bulk}"
        yield from _parameters(layer.choice, law.laws[layer.name] if issubclass(law, Layered) else law, f"{layer.name}.")
    if not case.sample.layer:
        part = case.material
        yield f"  material  {part.model or part.energy}, {_bulk(part, has_fibres(law))}"
        yield from _parameters(part, law)
    if case.relaxation is not None:
        for name, value in case.relaxation.parameters.items():
            yield f"    {name:<8}{_value(value, 's' if name.startswith('tau') else '1')}"
    if case.indentations and has_fibres(law):
        yield from _parts(case)
    ramps = ramps_of(case) if case.relaxation is not None else {}
    for test in case.tests:
        displacements = case.outputs(test)
        angle = "" if test.angle is None else f"{test.angle} degrees, {f'dipping {test.dip:g} degrees, ' if test.dip else ''}"
        if (specimen := case.specimen_of(test)) is not None:
            angle = f"{specimen.words}, {f'fibres {test.fibres}, ' if test.fibres else ''}"
        source = test.curve or test.record or "no curve"
        if (curve := case.curves[case.tests.index(test)]) is not None and curve.sd is not None:
            source = f"{source}, points weighed by their standard deviations"
        yield (
            f"  test      {test.name}: {angle}{case.points(test)} points to "
            f"{_end(case, test, displacements[-1])}, weight {test.weight:g}, {source}"
        )
        for field in test.field if test.kind == "indentation" else ():
            points = field.points
            seen = "displacements of points" if points.across is None else "points of the deformed outline"
            yield f"    its field   {field.label}: {points.values.size} {seen}, {points.file}"
        if test.name in ramps:
            ramp = ramps[test.name]
            yield f"    its ramp  {ramp.seconds:.4g} s, then {f'a hold of {ramp.hold:.4g} s' if ramp.hold else 'no hold'}"
        if test.control == "force" and test.force is not None and test.depth is not None:
            hold = f"a hold of {test.hold:.4g} s" if test.hold else "no hold"
            to = f"its creep is followed to {sizes(test.depth)}"
            yield f"    its force {quantity(test.force, 'mN')} after {test.ramp:.4g} s, then {hold}; {to}"
        if test.sample:
            yield f"    its sample    {sample_words(case.sample_of(test))}"
        if test.indenter:
            yield f"    its indenter  {indenter_words(case.indenter_of(test))}"
    for name in ("friction", "bulk_ratio", "thickness", "size", "base", "offset", "fibre_angle"):
        if stated := getattr(case.fit.uncertain, name):
            yield f"  uncertain {name}: {_doubt(name, stated)}"
    free = ", ".join([*case.free, *(case.relaxation.free if case.relaxation else {})]) or "none"
    yield f"  fit       {case.fit.method}, seed {case.fit.seed}; free parameters: {free}"


def _parameters(part: MaterialChoice, law: type[Material], prefix: str = "") -> Iterator[str]:
    """The parameters of a material, of a layer with its name before theirs."""
    for name, value in own_parameters(part, law).items():
        young = f" (young {_value(part.parameters[YOUNG], 'kPa')})" if name not in part.parameters else ""
        yield f"    {prefix + name + ' ':<8}{_value(value, law.parameters[name].unit)}{young}"
    for name in part.shared:
        yield f"    {prefix + name + ' ':<8}shared: that of the first family"


def _doubt(name: str, stated: Any) -> str:
    """How uncertain an input is, in words."""
    if isinstance(stated, Prior):
        return stated.words()
    if isinstance(stated, Range):
        return f"{stated.min:g} to {stated.max:g}, fitted"
    if isinstance(stated, Mapping):
        return ", ".join(f"{test}: {_doubt(name, own)}" for test, own in stated.items())
    return f"the other one with probability {float(stated):g}" if name == "base" else f"standard deviation {stated:g}"


def _end(case: Case, test: Test, last: float) -> str:
    """The largest displacement or strain of a test, and what it acts on."""
    if axes_of(test).across == "strain":
        return f"a strain of {last:g}"
    own = f" of {sizes(test.length)}" if test.length is not None else ""
    return f"{sizes(last)}{own}"


def sample_words(sample: Sample) -> str:
    """A table [sample] in words."""
    slides = {layer.name: " sliding on the next" if layer.interface == "sliding" else "" for layer in sample.layer}
    layers = ", ".join(f"{layer.name} {sizes(layer.thickness)}{slides[layer.name]}" for layer in sample.layer)
    layered = f" (layers from the top: {layers})" if layers else ""
    stretch = f", stretched {sample.prestretch:g} times along x, its ends held" if sample.prestretch is not None else ""
    return f"{sample.geometry.words()}, thickness {sizes(sample.thickness)}{layered}{stretch}, {sample.base} base"


def indenter_words(indenter: Indenter) -> str:
    """A table [indenter] in words."""
    friction = "sticking" if indenter.friction == "stick" else f"friction {indenter.friction:g}"
    return f"{indenter.geometry.words()}, {friction}"


def _bulk(material: MaterialChoice, fibres: bool) -> str:
    """How compressible the material is."""
    if material.poisson_ratio is not None:
        return f"Poisson's ratio {material.poisson_ratio:g}"
    if material.kappa:
        return f"kappa = {material.kappa:g} kPa"
    ratio = material.bulk_over_shear
    nu = f" (Poisson's ratio {material.poisson_ratio_at(1.0):.3g})" if ratio and ratio < SAYS_POISSON and not fibres else ""
    return f"kappa = {material.bulk_ratio:g} x shear modulus{nu}"


def _mesh(mesh: Mesh) -> str:
    if mesh.default:
        return f"chosen for an error of the force of at most {mesh.wanted_error:.1%}"
    return f"elements of {sizes(mesh.size)}" if mesh.size else f"about {mesh.elements} elements asked"


def _parts(case: Case) -> Iterator[str]:
    """The part of the sample that is solved for each test, by the symmetry that its fibres keep. Raises MeshError."""
    for piece in case.pieces:
        kept = [kept_by(case.law, case.mesh, case.fibres_of(test)) for test in piece.indentations]
        names = ", ".join(test.name for test in piece.indentations)
        yield f"  symmetry  {names}: {PART_WORDS[part_for(kept, case.mesh.symmetry)]}"


def _value(value: float | Range, unit: str) -> str:
    unit = f" {unit}" if unit not in ("", "1") else ""
    if isinstance(value, Range):
        return f"{value.min:g} to {value.max:g}{unit}, from {value.start:g}"
    return f"{value:g}{unit}, fixed"
