"""Moduli of curves by closed forms, beside those of a simulation or a fit: a half-space, and an elastic layer.

They are exact for small strain, no friction, and a layer much wider than the contact: under a sphere of 0.4 thicknesses a
neo-Hookean gel resists 4 % less at a depth of 0.1 radii, 7 % less at 0.2. Under a flat punch of 0.15 thicknesses that sticks it
resists 1 % less at a depth of 0.15 radii and 4 % less at half a radius; under one that slips 9 to 13 % less there, as far as a
sharp edge has a force at all. Spheres and flat punches on materials without fibres have them.

Of a material that relaxes, the elastic force is inside of a hereditary integral (Lee and Radok 1960, J Appl Mech 27:438), with the
relaxation of the fit: the closed forms then give the modulus of its base, at once or after infinite time.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import stdtrit

from indentfit.arrays import Array, Ints
from indentfit.case import Case, Test
from indentfit.case.laws import has_fibres
from indentfit.curve import Curve
from indentfit.digits import quantity
from indentfit.indenters import IndenterShape, Rings, has_sharp_edge
from indentfit.layer import Layer

SMALL = (0.05, 0.1, 0.2)  # of the indenter's radius and of the thickness: forces up to the first depth that suffices count
APART, SCATTERS = 0.02, 2.0  # of the modulus, and of its scatter: a fit that differs by less agrees
NEAR = 0.01  # of the force: the model's and the layer's agree at the deepest point
FEWEST = 5  # points that count, where fewer lie above that depth
OUTSIDE = "the elastic layer's modulus lies outside of the interval: "
OF_LAW = "the layer's is the modulus at small strain, the fit's that of its law over all fitted forces"
OF_MISFIT = '; to widen the interval by what the law misses, give [fit.discrepancy] with scale = "unknown"'
SOLVED = 1e-3  # relative error of the layer's own solution: a modulus outside by less is not outside
WORSE = 2.0  # a fit is so many times farther from the forces than the layer, before the layer speaks against the fit
EXPLAINED = 1.5  # a fit that differs by at most so many times what finite strain does to the last force is explained by it
BENDS = 0.05  # of the modulus, by which that of the deeper half of the forces is another
BULK = "bulk_ratio"
SUFFICES = 0.05  # relative half-width of the modulus's 95 % interval, by the scatter of the forces
Elastic = Callable[[Array, float], Array]  # depths (n,), mm, and nu -> forces (n,), mN
Over = Callable[[Elastic, float], Array]  # elastic forces, and nu -> forces of the points of a curve, mN


@dataclass(frozen=True)
class ClosedForm:
    """Moduli of one curve at small depth.

    Parameters
    ----------
    formula : str
        "Hertz" or "flat punch" (Sneddon), on a half-space.
    half_space, layer : float, kPa
        Shear modulus by the half-space and by the layer of the sample's thickness.
    base : "sliding" or "bonded"
    poisson_ratio : float
    depth : float, mm
        Depth up to which forces count.
    points : int
        Number of these forces.
    scatter : float
        Relative half-width of the 95 % interval of both moduli, by the scatter of these forces about the layer's.
    end : float or None, mN
        Force of the layer with a shear modulus of 1 kPa at the deepest point of the curve.
    sphere : float
        Share by which a sphere resists less there than the paraboloid that stands for it in Hertz's theory and in the layer, by
        Sneddon (1965, Int J Eng Sci 3:47) on a half-space; 0 for other indenters.
    misfit : float or None
        RMSE of all forces against the layer's, over the largest force.
    bend : float
        By what share the layer's modulus of the deeper half of these forces exceeds that of the other half; 0 where their scatter
        can explain it.
    base_in_time : str
        Of a material that relaxes, whose modulus it is: "long_term" or "instantaneous"; empty for another.
    """

    formula: str
    half_space: float
    layer: float
    base: str
    poisson_ratio: float
    depth: float
    points: int
    scatter: float
    end: float | None = None
    sphere: float = 0.0
    misfit: float | None = None
    bend: float = 0.0
    base_in_time: str = ""

    def young(self, shear_modulus: float) -> float:
        """Young's modulus of a shear modulus, kPa."""
        return 2 * shear_modulus * (1 + self.poisson_ratio)

    def words(self) -> str:
        """The moduli in words, with what they assume."""
        half, layer = (f"E {self.young(mu):.3g} kPa (mu {mu:.3g})" for mu in (self.half_space, self.layer))
        name = "Hertz" if self.formula == "Hertz" else "flat punch on a half-space"
        return (
            f"elastic layer {layer}, {name} {half}, +- {self.scatter:.1%} by scatter, {self.points} forces to "
            f"{quantity(self.depth, 'mm', 3)} (small strain, wide layer, {self.base} base, no friction, "
            f"nu {self.poisson_ratio:.4g}{self.of_time()}){self._bends()}"
        )

    def of_time(self) -> str:
        """Which modulus of a material that relaxes it is, in words after a comma; empty for another."""
        return f", {self.base_in_time.replace('_', '-')} moduli with the relaxation of the fit" if self.base_in_time else ""

    def _bends(self) -> str:
        """That the forces do not follow the closed form, whose modulus then is a mean and has another error than the scatter."""
        if abs(self.bend) < BENDS:
            return ""
        bends, other = ("stiffen", "more") if self.bend > 0 else ("soften", "less")
        return (
            f"; these forces {bends} beside it: their deeper half alone gives {abs(self.bend):.0%} {other} than the rest, "
            "so this is the modulus of no depth"
        )

    def beside(self, shear_modulus: float, deepest: float) -> str:
        """Why a fit of all forces, to a deepest one (mm), has another shear modulus; empty where both agree."""
        apart = shear_modulus / self.layer - 1
        if abs(apart) <= max(APART, SCATTERS * self.scatter):
            return ""
        side = "above" if apart > 0 else "below"
        return (
            f"mu of the fit is {abs(apart):.1%} {side} that of the elastic layer: the layer takes forces to "
            f"{quantity(self.depth, 'mm', 3)}, at small strain and without friction, the fit all forces to "
            f"{quantity(deepest, 'mm', 3)}; finite strain, friction, the sample's width, "
            f"or a law {'or relaxation ' if self.base_in_time else ''}that does not follow the curve make the difference"
        )

    def at_the_end(self, shear_modulus: float, model: Curve) -> str:
        """How far the model's curve is from the layer of its modulus at the deepest point, and what makes it so; empty where it is
        not."""
        if self.end is None:
            return ""
        deepest, off = model.displacement[-1], float(model.force[-1]) / (self.end * shear_modulus) - 1
        if abs(off) <= NEAR:
            return ""
        sphere = (
            f"{self.sphere:.1%} of it because a sphere is no paraboloid, the rest" if self.sphere >= 0.001 and off < 0 else "made"
        )
        side, at = "below" if off < 0 else "above", quantity(float(deepest), "mm", 3)
        return (
            f"at {at} the model's force is {abs(off):.1%} {side} that of the layer of the same modulus, {sphere} by "
            f"finite strain, friction and the sample's width: that much {'lower' if off < 0 else 'higher'} is the modulus that "
            "Hertz's theory or the layer gives to forces of that depth"
        )

    def outside(self, test: str, shear_modulus: float, interval: tuple[float, float], model: Curve, misfit: float) -> str:
        """That the layer's modulus lies outside of the interval of a fit's shear modulus, kPa, although the layer follows the same
        forces better than the fitted law does; with the cause, or that nothing here explains it. Empty otherwise.

        Parameters
        ----------
        test : str
        shear_modulus, interval : float, (low, high), kPa
        model : Curve
            Of the fit, to the deepest of the fitted points.
        misfit : float
            RMSE of the fit over the largest force.
        """
        low, high = interval
        error = max(self.scatter, SOLVED)
        inside = low <= self.layer * (1 + error) and self.layer * (1 - error) <= high
        if inside or self.end is None or self.misfit is None or misfit <= WORSE * self.misfit:
            return ""
        return (
            f"{OUTSIDE}{test}: mu {self.layer:.4g} kPa by the layer, whose forces are {self.misfit:.2%} off, {low:.4g} to "
            f"{high:.4g} kPa by the fit, {misfit:.2%} off; {self._why_outside(shear_modulus, model)}"
        )

    def _why_outside(self, shear_modulus: float, model: Curve) -> str:
        """Whether finite strain explains that a fit's shear modulus is not the layer's."""
        assert self.end is not None
        apart, off = shear_modulus / self.layer - 1, float(model.force[-1]) / (self.end * shear_modulus) - 1
        if apart * off >= 0 or abs(apart) > EXPLAINED * abs(off):
            return (
                f"finite strain, friction and the sample's width change the last force by {off:+.1%} only and do not explain that; "
                "check thickness, base, contact point and law"
            )
        bends = f"{'softens' if off < 0 else 'stiffens'} by {abs(off):.1%} to {model.displacement[-1]:.3g} mm"
        return f"the cause: under finite strain the law {bends}, and these forces do not; {OF_LAW}"

    def as_json(self) -> dict[str, Any]:
        """The keys in result.json and simulation.json."""
        return asdict(self)


def closed_forms(
    case: Case, curves: Mapping[str, Curve], shear_modulus: float, fitted: Mapping[str, Any] | None = None
) -> dict[str, ClosedForm]:
    """The ClosedForm of each curve that has one.

    Parameters
    ----------
    case : Case
    curves : mapping of the name of a test to its curve
    shear_modulus : float, kPa
        Of the simulation or the fit: it decides Poisson's ratio where the case gives a bulk modulus.
    fitted : mapping of name -> value, or None
        The parameters of a fit, and inputs as `runs.points` takes them: a fitted bulk ratio decides Poisson's ratio, a fitted
        thickness, base or indenter's size the layer, and the parameters of a relaxation the forces in time. A material that
        relaxes has no closed forms without.

    Returns
    -------
    dict of test -> ClosedForm
        Empty for a material with fibres, and for a sample with layers.
    """
    if has_fibres(case.law) or (case.material.relaxation is not None and fitted is None) or next(left_out(case), None):
        return {}
    if fitted is not None:
        from indentfit.runs.points import case_at  # it needs the models, which have closed forms beside them

        case = case_at(case, fitted)
    nu = case.material.poisson_ratio_at(shear_modulus)
    tests = [test for test in case.indentations if test.name in curves]
    forms = {test.name: _closed_form(case, test, curves[test.name], nu, fitted or {}) for test in tests}
    return {name: form for name, form in forms.items() if form is not None}


def left_out(case: Case) -> Iterator[str]:
    """Why curves of round indenters have no closed form, where the sample has layers or was stretched."""
    beside = "no modulus by Hertz's theory, Sneddon's punch or the elastic layer stands beside"
    if not any(formula_of(case.indenter_of(test).geometry) for test in case.indentations):
        return
    if case.sample.layer:
        yield f"{beside}: they are those of one material, and the sample has layers"
    elif any(case.sample_of(test).prestretch for test in case.indentations):
        yield f"{beside}: they are those of a sample without stress, and this one was stretched before"


def _closed_form(case: Case, test: Test, curve: Curve, nu: float, relaxed: Mapping[str, Any]) -> ClosedForm | None:
    shape, sample, relaxation = case.indenter_of(test).geometry, case.sample_of(test), case.relaxation
    thickness = sample.thickness
    formula = formula_of(shape)
    if not formula or not 0 <= nu <= 0.5:
        return None
    radius = shape.half_width / thickness
    if relaxation is None:
        over = _over_depth(curve)
    else:
        from indentfit.runs.closed_in_time import over_time  # it needs the models, which have closed forms beside them

        over = over_time(case, test, curve, relaxed)

    def of_layer(depth: Array, nu: float) -> Array:
        return _forces(formula, Layer(sample.base == "bonded", nu), radius, depth / thickness) * thickness**2

    def of_half_space(depth: Array, nu: float) -> Array:
        return _half_space(formula, nu, radius, depth / thickness) * thickness**2

    try:
        unit = over(of_layer, nu)
    except ValueError:  # far wider than thick
        return None
    half = over(of_half_space, nu)
    force, last = curve.force, unit.size - 1
    for share in SMALL:
        small = _small(curve, share * min(shape.half_width, thickness), last)
        exact, scatter = _modulus(unit[small], force[small])
        if scatter < SUFFICES:
            break
    deepest, timed = curve.deepest, relaxation is not None
    misfit = float(np.sqrt(np.mean((force[: last + 1] - exact * unit) ** 2)) / np.max(np.abs(force)))
    return ClosedForm(
        formula,
        half_space=_modulus(half[small], force[small])[0],
        layer=exact,
        base=sample.base,
        poisson_ratio=nu,
        depth=float(curve.displacement[small].max()),
        points=small.size,
        scatter=scatter,
        end=None if timed else float(unit[-1]),
        sphere=_sphere(deepest / shape.half_width) if formula == "Hertz" else 0.0,
        misfit=misfit,
        bend=_bend(unit[small], force[small]),
        base_in_time=relaxation.base if relaxation is not None else "",
    )


def _over_depth(curve: Curve) -> Over:
    """Elastic forces at the depths of a curve."""
    return lambda of, nu: of(np.maximum(curve.displacement, 0.0), nu)


def _sphere(depth: float) -> float:
    """Share by which a sphere of radius 1 resists less than its paraboloid, at a depth below 1.

    Sneddon 1965, with the radius of contact a: the depth is a/2 ln((1 + a) / (1 - a)), the force, over that of the paraboloid,
    4/3 depth^1.5, (a^2 + 1)/2 ln((1 + a) / (1 - a)) - a.
    """
    if not 0 < depth < 1:
        return 0.0
    a = float(brentq(_excess_depth, 1e-9, 1 - 1e-12, args=(depth,)))
    return float(1 - ((a * a + 1) * np.arctanh(a) - a) / (4 / 3 * depth**1.5))


def _excess_depth(a: float, depth: float) -> float:
    return float(a * np.arctanh(a)) - depth


def _modulus(unit: Array, force: Array) -> tuple[float, float]:
    """The shear modulus, kPa, of forces where those of 1 kPa are known, and the relative half-width of its 95 % interval."""
    modulus = float(force @ unit / (unit @ unit))
    variance = ((force - modulus * unit) ** 2).sum() / max(force.size - 1, 1) / (unit @ unit)
    return modulus, float(stdtrit(max(force.size - 1, 1), 0.975) * np.sqrt(variance) / abs(modulus)) if modulus else np.inf


def _bend(unit: Array, force: Array) -> float:
    """The relative difference of the moduli of the two halves of forces, the deeper over the other; 0 within their scatter."""
    middle = force.size // 2
    (shallow, near), (deep, far) = _modulus(unit[:middle], force[:middle]), _modulus(unit[middle:], force[middle:])
    apart = deep / shallow - 1 if shallow else 0.0
    return apart if abs(apart) > np.hypot(near, far) else 0.0


def formula_of(shape: IndenterShape) -> str:
    """The closed form of an indenter: that of a sphere, of a flat punch with a sharp edge, or none."""
    if not isinstance(shape.partition(0.0), Rings):
        return ""
    if shape.end == "sphere":
        return "Hertz" if abs(shape.curvature * shape.half_width - 1) < 1e-9 else ""
    return "flat punch" if has_sharp_edge(shape) else ""


def _small(curve: Curve, limit: float, last: int) -> Ints:
    """Numbers of the points of a curve, up to a last one, with depths above zero up to a limit, at least of the first FEWEST."""
    pressed = np.flatnonzero(curve.displacement[: last + 1] > 0)
    beyond = curve.displacement[pressed] > limit
    count = int(np.argmax(beyond)) if beyond.any() else pressed.size
    return pressed[: max(count, FEWEST)]


def _forces(formula: str, layer: Layer, radius: float, depth: Array) -> Array:
    """Forces on a layer with thickness 1 and shear modulus 1."""
    return layer.sphere_force(radius, depth) if formula == "Hertz" else layer.punch_stiffness(radius) * depth


def _half_space(formula: str, nu: float, radius: float, depth: Array) -> Array:
    """Forces on a half-space with shear modulus 1: Hertz 1881, Sneddon 1965."""
    if formula == "Hertz":
        return 8 / (3 * (1 - nu)) * np.sqrt(radius) * depth**1.5
    return 4 * radius / (1 - nu) * depth
