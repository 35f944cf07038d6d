"""A case made of records alone: what the files state, what the records show, and what only the experimenter knows."""

from __future__ import annotations

import contextlib
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from indentfit.case import Record
from indentfit.errors import RecordError
from indentfit.experiment.outcomes import Usable
from indentfit.indenters import SHAPES
from indentfit.units import number_in

TABLES = ("sample", "indenter", "material", "mesh", "fit", "solver")
MOST_TESTS = 12  # of a case: each is a curve of its own
WITH_SIZES = ("sample", "indenter")  # tables whose values with units are lengths
SIZES = {"disc": ("diameter", "thickness"), "block": ("length", "width", "thickness")}
RANGE = 1000.0  # the range of the modulus about that of the record, as a factor: thin layers and soft first contacts lie far off
WIDTHS = {"diameter": 1.0, "width": 1.0, "radius": 2.0}  # keys of an indenter, over its width
INCOMPRESSIBLE = 0.75  # E over E / (1 - nu^2) with nu = 0.5
POISSON = 0.499  # of a sample whose file and experimenter do not tell another: tissue and gels hardly change their volume
DIGITS = 3
RELAXES = 0.98  # share of the force that a hold keeps, below which its relaxation is told
Tree = dict[str, Any]


@dataclass(frozen=True)
class FileCase:
    """The keys of a case that a file cannot know: table -> key -> value, as --set gives them."""

    told: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @classmethod
    def of(cls, overrides: Sequence[str]) -> FileCase:
        """The keys of overrides TABLE.KEY=VALUE or TABLE.KEY.KEY=VALUE, VALUE as TOML writes it, or text."""
        told: dict[str, dict[str, Any]] = {}
        for text in overrides:
            key, _, value = text.partition("=")
            table, *tables, name = key.strip().split(".")
            place = told.setdefault(table, {})
            for inner in tables:
                place = place.setdefault(inner, {})
                if not isinstance(place, dict):
                    raise RecordError(
                        f"--case: --set {text}: {inner} has a value already, and cannot hold {name}; give one of both"
                    )
            place[name] = _in_mm(_value(value.strip())) if table in WITH_SIZES else _value(value.strip())
        return cls(told)

    @property
    def in_time(self) -> bool:
        """Whether the material relaxes: the curves then have times, and their holds are fitted too."""
        return "relaxation" in self.told.get("material", {})

    def reading(self, settings: Record) -> Record:
        """The [record] table with the end of the indenter that is told, and the radius of its sphere, where it has none.

        Parameters
        ----------
        settings : Record

        Returns
        -------
        Record
        """
        indenter = self.told.get("indenter", {})
        shape = SHAPES.find(str(indenter.get("shape", "")))
        if shape is None or settings.indenter or settings.radius:
            return settings
        radius = indenter.get("radius") if shape.end == "sphere" else None
        known = {"radius": float(radius)} if isinstance(radius, int | float) and radius > 0 else {}
        return settings.model_copy(update={"indenter": shape.end, **known})

    def presumed(self, good: Sequence[Usable]) -> Iterator[str]:
        """One line for each key that neither the file nor the experimenter tells, and that changes the result."""
        if not {"poisson_ratio", "bulk_ratio"} & set(self.told.get("material", {})):
            source = "as the file states" if good[0].processed.record.stated.poisson else "as tissue and gels have it"
            yield (
                f"--case: Poisson's ratio is taken as {_poisson(good):g}, {source}: a fit's modulus goes by it; tell another by "
                "--set material.poisson_ratio=0.3, or --set material.bulk_ratio=unknown"
            )
        for outcome in good:
            hold = outcome.processed.relaxation
            if hold is not None and not self.in_time and hold.ratio < RELAXES:
                yield (
                    f"--case: {outcome.name}: the force falls in the hold, to {hold.ratio:.1%} in the end; the case has "
                    "the loading alone, and its moduli are those of that ramp; --set material.relaxation.terms=2 fits the hold too"
                )
        if "friction" not in self.told.get("indenter", {}):
            yield "--case: friction is not known, and a fit goes over 0 to 1; tell it by --set indenter.friction=0"

    def tree(self, good: Sequence[Usable], radius: float | None, curves: Mapping[str, str]) -> Tree:
        """The tables of the case.

        Parameters
        ----------
        good : sequence of Usable
            The records.
        radius : float or None, mm
            Of the sphere, where the settings state it.
        curves : mapping
            Name of each usable record -> the file of its curve.

        Returns
        -------
        dict

        Raises
        ------
        RecordError
            Keys that the file cannot know are missing, or there are too many records.
        """
        if len(good) > MOST_TESTS:
            raise RecordError(
                f"--case: {len(good)} records in one case are too many; choose some with record.block or record.segment"
            )
        tree: Tree = {
            "title": f"from {good[0].name}" if len(good) == 1 else f"{len(good)} records, from {good[0].name} on",
            "sample": dict(self.told.get("sample", {})),
            "indenter": {**_indenter(radius, good), "friction": "unknown", **self.told.get("indenter", {})},
        }
        tree["sample"].setdefault("shape", "disc")
        for key, value in _thickness(good):
            tree["sample"].setdefault(key, value)
        _require(tree)
        material = {"model": "neo_hookean", **self.told.get("material", {})}
        if not {"poisson_ratio", "bulk_ratio"} & set(material):
            material["poisson_ratio"] = _poisson(good)
        if "parameters" not in material and material["model"] == "neo_hookean":
            material["parameters"] = {"young": _range(_modulus(good[0], tree["indenter"]))}
        tree["material"] = material
        tree["test"] = [{"name": _name(n, len(good)), "curve": curves[outcome.name]} for n, outcome in enumerate(good, start=1)]
        return tree | {table: dict(self.told[table]) for table in ("mesh", "fit", "solver") if table in self.told}


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _in_mm(value: Any) -> Any:
    """A length with its unit as a number, mm; any other value as it is, which the case takes or refuses."""
    with contextlib.suppress(ValueError):
        return number_in("mm", value) if isinstance(value, str) else value
    return value


def _indenter(radius: float | None, good: Sequence[Usable]) -> Tree:
    """The indenter that the settings, or the files, state; empty where they state none."""
    radius = radius or next((outcome.processed.record.stated.radius for outcome in good), None)
    return {"shape": "sphere", "radius": float(f"{radius:.6g}")} if radius else {}


def _poisson(good: Sequence[Usable]) -> float:
    return min(good[0].processed.record.stated.poisson or POISSON, POISSON)


def _thickness(good: Sequence[Usable]) -> Iterator[tuple[str, float]]:
    for key in ("thickness", "diameter"):
        value = getattr(good[0].entry, key)
        if value:
            yield key, value


def _require(tree: Tree) -> None:
    """Ask, in one line, for what the file cannot know."""
    sample, indenter = tree["sample"], tree["indenter"]
    wanted = [f"sample.{key}" for key in SIZES.get(sample["shape"], ("thickness",)) if key not in sample]
    wanted += ["sample.base"] if "base" not in sample else []
    examples = {"sample.base": "sample.base=unknown (or bonded, or sliding)"}
    if "shape" not in indenter:
        wanted = [*wanted, "indenter.shape", "indenter.radius or diameter"]
        examples |= {"indenter.shape": "indenter.shape=sphere (or cylinder)", "indenter.radius or diameter": "indenter.radius=0.5"}
    if wanted:
        shown = " ".join(f"--set {examples.get(key, f'{key}=5')}" for key in wanted)
        raise RecordError(f"--case: the record cannot tell {', '.join(wanted)}: give {shown} (lengths in mm)")


def _modulus(outcome: Usable, indenter: Tree) -> float:
    """Young's modulus, kPa, at which the fit begins: by Hertz, or by the slope under a flat punch."""
    record = outcome.processed
    if record.hertz is not None:
        return INCOMPRESSIBLE * record.hertz.modulus
    sizes = (factor * indenter[key] for key, factor in WIDTHS.items() if isinstance(indenter.get(key), int | float))
    return INCOMPRESSIBLE * record.line.slope / next((size for size in sizes if size > 0), 2 * record.depth)


def _range(modulus: float) -> Tree:
    start, least, most = (float(f"{value:.{DIGITS}g}") for value in (modulus, modulus / RANGE, modulus * RANGE))
    return {"start": start, "min": least, "max": most}


def _name(number: int, count: int) -> str:
    return "press" if count == 1 else f"press_{number}"
