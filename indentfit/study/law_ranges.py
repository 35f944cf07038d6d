"""The laws of a comparison as cases, with automatic ranges for the parameters to which the case gives none.

Automatic ranges follow the stiffness of the curves: moduli are ranges of multiples of the shear modulus with which an isotropic
neo-Hookean sample of the same size would follow the curves. In a comparison these ranges are priors: each parameter is uniform over
its range, so the evidence of a law depends on them (a range ten times as wide costs about 2.3 in the logarithm).
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from indentfit.case import Case, Range
from indentfit.case.laws import YOUNG, law_of_choice, open_law, own_parameters
from indentfit.case.materials import Layer, MaterialChoice
from indentfit.errors import CaseError, MaterialError, suggestion
from indentfit.experiment.measured import changed_case
from indentfit.inverse.methods import SEARCHES
from indentfit.inverse.wide import alternatives, uncertain_inputs
from indentfit.material import FUNCTIONS, INVARIANTS, SECOND_FAMILY, STRETCHES, Material, Parameter, trial_values

Usual = tuple[float, float, float]  # start, least, largest; those of moduli are multiples of the curves' shear modulus
MODULUS: Usual = (1.0, 0.02, 5.0)
HALF: Usual = (0.25, 0.0, 2.5)
FURTHER: Usual = (0.5, 0.0, 5.0)  # further moduli, such as coefficients of higher powers
NUMBER: Usual = (1.0, 0.0, 20.0)
OF_LAWS: dict[str, dict[str, Usual]] = {  # ranges that the literature on soft tissue and gels needs, by law and parameter
    "ArrudaBoyce": {"lambda_m": (2.0, 1.05, 5.0)},
    "DemirayFung": {"b": (1.0, 1e-3, 20.0)},
    "Gent": {"Jm": (3.0, 0.3, 30.0)},
    "Holzapfel": {"k1": (2.0, 0.0, 20.0), "k2": (1.0, 1e-3, 30.0), "dispersion": (0.1, 0.0, 1 / 3)},
    "MooneyRivlin": {"c10": HALF, "c01": HALF},
    "Ogden": {"alpha": (4.0, -15.0, 25.0)},
    "Ogden2": {"mu1": MODULUS, "alpha1": (4.0, 1.0, 25.0), "mu2": MODULUS, "alpha2": (-4.0, -15.0, -1.0)},
    "Ogden3": {
        "mu1": MODULUS, "alpha1": (4.0, 1.0, 8.0), "mu2": MODULUS, "alpha2": (-4.0, -15.0, -1.0),
        "mu3": (0.1, 0.02, 5.0), "alpha3": (10.0, 8.0, 25.0),
    },
    "Polynomial": {"c10": HALF, "c01": HALF, "c20": FURTHER, "c11": FURTHER, "c02": FURTHER},
    "TransverselyIsotropic": {"zeta": (3.0, 0.0, 20.0), "phi": (1.0, 0.0, 5.0)},
    "Yeoh": {"c10": (0.5, 0.01, 2.5), "c20": FURTHER, "c30": FURTHER},
}  # fmt: skip
INSTALLED = re.compile(r"[A-Za-z_][\w-]*")
ANYWHERE = ("fit.published={}", "fit.what_if=false")
MOST_MODULI = 6  # parameters among which moduli are looked for


def laws_asked(text: str) -> list[str]:
    """The laws in a list such as "neo_hookean,mine.py:Mine,mu/2*(I1-3)"; a comma inside of brackets separates nothing."""
    laws, depth = [""], 0
    for letter in text:
        depth += (letter == "(") - (letter == ")")
        if letter == "," and depth == 0:
            laws.append("")
        else:
            laws[-1] += letter
    return [law.strip() for law in laws if law.strip()]


def law_case(case: Case, law: str, modulus: float | None, ranges: Mapping[str, Range], layer: str | None = None) -> Case:
    """The case with another law, of its sample or of one of its layers.

    Parameters
    ----------
    case : Case
    law : str
        Name of an installed law, file.py:Class, or a typed energy.
    modulus : float or None, kPa
        The shear modulus that the curves ask for (see `indentfit.study.compare`). The law of the case keeps its own ranges; but
        its moduli have automatic ones where these are narrower, or it would pay in evidence for a range that nobody meant.
    ranges : mapping of parameter -> Range
        Ranges in place of the automatic ones.
    layer : str or None
        The name of the layer whose law it is; the others keep theirs.

    Returns
    -------
    Case

    Raises
    ------
    CaseError
        The law cannot be found or used, or a range is not admissible; the text names the law.
    """
    try:
        table_of = "material" if layer is None else f"sample.layer.{layer}"
        if is_own(case, law, layer):
            narrowed = () if modulus is None else _narrowed(case, modulus, ranges, layer, table_of)
            return changed_case(case, [*narrowed, *_ranges_given(ranges, table_of), *_of_search(case)])
        kind, names = _kind_of(law)
        opened = open_law(law if kind == "model" else None, law if kind == "energy" else None, names, case.folder)
        assert modulus is not None
        free = {name: ranges.get(name) or usual_range(opened, name, modulus) for name in opened.parameters}
        if unknown := set(ranges) - set(free):
            raise CaseError([f"it has no parameter {sorted(unknown)[0]!r}; it has: {', '.join(free)}"])
        table = ", ".join(f"{name} = {_as_toml(bounds)}" for name, bounds in free.items())
        shared = [f"{table_of}.shared=[]"] if owner_of(case, layer).shared else []
        material = [f"{table_of}.{kind}={_quoted(law)}", f"{table_of}.parameters={{ {table} }}", *shared]
        return changed_case(case, [*material, *_of_search(case)])
    except CaseError as error:
        raise CaseError([f"law {law!r}: {fault}" for fault in error.faults]) from error
    except (MaterialError, OSError) as error:
        raise CaseError([f"law {law!r}: {error}"]) from error


def _narrowed(case: Case, modulus: float, given: Mapping[str, Range], layer: str | None, table_of: str) -> tuple[str, ...]:
    """The keys by which moduli of the case's own law have automatic ranges, where those of the case are wider."""
    owner = owner_of(case, layer)
    choice = owner.choice if isinstance(owner, Layer) else owner
    law = law_of_choice(choice, case.folder)
    parameters, cut = dict(own_parameters(choice, law)), False
    for name in moduli_of(law) - set(given):
        bounds, usual = parameters.get(name), usual_range(law, name, modulus)
        if YOUNG in given or not isinstance(bounds, Range) or bounds.max - bounds.min <= usual.max - usual.min:
            continue
        low, high = max(bounds.min, usual.min), min(bounds.max, usual.max)
        if low < high:  # otherwise the case says that the curves' stiffness is not that of this parameter
            parameters[name], cut = Range(start=min(max(bounds.start, low), high), min=low, max=high), True
    table = ", ".join(
        f"{name} = {_as_toml(known) if isinstance(known, Range) else repr(known)}" for name, known in parameters.items()
    )
    return (f"{table_of}.parameters={{ {table} }}",) if cut else ()


def _of_search(case: Case) -> tuple[str, ...]:
    """Keys of the search. Intervals are those of the comparison, and need no profiles; but uncertain inputs are coordinates of such
    fits alone that search on a surrogate, with profiles."""
    if not uncertain_inputs(case) and len(alternatives(case)) == 1:
        return (*ANYWHERE, "fit.profiles=false")
    method = case.fit.method if case.fit.method in SEARCHES else "ga"
    return (*ANYWHERE, "fit.profiles=true", "fit.direct=false", f"fit.method={method}")


def is_own(case: Case, law: str, layer: str | None = None) -> bool:
    """Whether a law is that of the case itself, or of one of its layers."""
    own = owner_of(case, layer)
    return law in (own.model, own.energy)


def owner_of(case: Case, layer: str | None) -> MaterialChoice | Layer:
    """The table whose law is compared: that of a layer, or of the sample. Raises CaseError."""
    layers = {table.name: table for table in case.sample.layer}
    if not layers and layer is None:
        return case.material
    if not layers:
        raise CaseError([f"--layer {layer}: the sample has no layers; take it away"])
    known = f"(layers: {', '.join(layers)})"
    if layer is None:
        raise CaseError([f"the sample has layers: say whose laws are compared, such as --layer {next(iter(layers))} {known}"])
    if layer not in layers:
        raise CaseError([f"--layer {layer}: no such layer{suggestion(layer, list(layers))} {known}"])
    return layers[layer]


def usual_range(law: type[Material], name: str, modulus: float) -> Range:
    """The automatic range of a parameter of a law, for curves that ask for a shear modulus, kPa."""
    parameter = law.parameters[name]
    moduli = moduli_of(law)
    stated = OF_LAWS.get(law.__name__, {}).get(name)
    start, low, high = stated or _by_kind(parameter, name in moduli, name == law.scale)
    size = modulus if name in moduli else 1.0
    low, high = _admitted(parameter, low * size, high * size)
    start = min(max(start * size, low), high)
    return Range(start=_rounded(start), min=_rounded(low), max=_rounded(high))


def moduli_of(law: type[Material]) -> set[str]:
    """The parameters that have the unit of a modulus: those with the unit kPa, or, of a typed energy, which has no units, the
    fewest to which the energy is proportional together."""
    stated = {name for name, parameter in law.parameters.items() if parameter.unit == "kPa"}
    if stated or law.scale is not None:
        return stated or {str(law.scale)}
    names = list(law.parameters)[:MOST_MODULI]
    for number in range(1, len(names) + 1):
        for chosen in combinations(names, number):
            if _proportional(law, chosen):
                return set(chosen)
    return set()


def _proportional(law: type[Material], names: Sequence[str]) -> bool:
    rng = np.random.default_rng(0)
    values = trial_values(law.parameters, rng)
    I = np.array([3.2, 3.3, 1.2, 1.5])
    doubled = {**values, **{name: 2 * values[name] for name in names}}
    single, double = float(law(**values).psi(I)), float(law(**doubled).psi(I))
    return abs(double - 2 * single) <= 1e-9 * abs(double)


def _by_kind(parameter: Parameter, modulus: bool, scale: bool) -> Usual:
    if scale or (modulus and "shear modulus" in parameter.meaning and "half" not in parameter.meaning):
        return MODULUS
    return FURTHER if modulus else NUMBER


def _admitted(parameter: Parameter, low: float, high: float) -> tuple[float, float]:
    least = -np.inf if parameter.min is None else parameter.min
    most = np.inf if parameter.max is None else parameter.max
    low, high = max(low, least), min(high, most)
    if low >= high:  # the law admits none of the usual values
        low = least if np.isfinite(least) else most - abs(most) - 1
        high = min(low + 10 * (abs(low) or 1.0), most)
    return low, high


def _ranges_given(ranges: Mapping[str, Range], table: str) -> Iterator[str]:
    for name, bounds in ranges.items():
        yield f"{table}.parameters.{name}={_as_toml(bounds)}"


def _kind_of(law: str) -> tuple[str, tuple[str, ...]]:
    """The key of [material] that names a law, and the parameters of a typed energy."""
    if INSTALLED.fullmatch(law) or ".py:" in law:
        return "model", ()
    known = {*INVARIANTS, *SECOND_FAMILY, *STRETCHES, *FUNCTIONS}
    names = dict.fromkeys(name for name in re.findall(r"(?<![\w.])[A-Za-z_]\w*", law) if name not in known)
    return "energy", tuple(names)


def _as_toml(bounds: Range) -> str:
    return f"{{ start = {bounds.start!r}, min = {bounds.min!r}, max = {bounds.max!r} }}"


def _quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")
