"""The tables of materials as frozen values: [material], and [[sample.layer]] of a sample with several layers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WrapValidator

from indentfit import elastic
from indentfit.case.quantities import BulkRatio, Length, Line, Pressure, as_tuple
from indentfit.case.ranges import Range, fixed_or_range
from indentfit.case.relaxation import Relaxation
from indentfit.case.section import Section, either, known
from indentfit.material import Material, parts_of

DEFAULT_BULK_RATIO = 1000.0
LARGEST_BULK_RATIO = 2e5  # the solver takes this ratio for an exactly incompressible sample
SAME_THICKNESS = 1e-6  # relative difference of the layers' thicknesses from that of the sample, by round-off
BULK = ("bulk_ratio", "kappa", "poisson_ratio")  # the keys that say how compressible a material is


class MaterialChoice(Section):
    """The material: an installed model, `file.py:Class`, or a typed energy, with its parameters."""

    place = "material"
    rivals = either("model", "energy") | either("bulk_ratio", "kappa", "poisson_ratio")

    model: Line | None = Field(
        default=None,
        examples=["transversely_isotropic"],
        description="name of an installed material (`indentfit materials` lists them), or file.py:Class, which runs that file",
    )
    energy: Line | None = Field(
        default=None,
        examples=["mu/2*(I1 - 3)"],
        description="energy instead of a model, a formula in I1, I2, I4, I5, of a second family of fibres I6, I7, I8, the "
        "principal stretches l1, l2, l3, and the parameters",
    )
    parameters: dict[str, Annotated[float | Range, WrapValidator(fixed_or_range)]] = Field(
        default_factory=dict,
        description="parameters of the material, each a number, or {start, min, max} to be fitted; young (kPa) may stand for the "
        "shear modulus of an isotropic law",
    )
    shared: Annotated[tuple[Line, ...], BeforeValidator(as_tuple)] = Field(
        default=(),
        examples=[["k2_second"]],
        description="parameters of the second family of fibres that are those of the first, such as k2_second; they have no value "
        "of their own",
    )
    bulk_ratio: BulkRatio | None = Field(
        default=None,
        examples=[DEFAULT_BULK_RATIO],
        description='bulk modulus over shear modulus, or "unknown" (20 to 5000), as it is without kappa and poisson_ratio',
    )
    kappa: Pressure | None = Field(default=None, examples=[1490.0], description="bulk modulus, instead of bulk_ratio")
    poisson_ratio: Annotated[float, Field(ge=0, le=0.5, allow_inf_nan=False)] | None = Field(
        default=None,
        examples=[0.45],
        description="Poisson's ratio nu, instead of bulk_ratio = 2 (1 + nu) / (3 (1 - 2 nu)); 0.5 is exactly incompressible; for "
        "materials without fibres",
    )
    relaxation: Relaxation | None = Field(default=None, description="table of the relaxation of the stress in time")

    @property
    def bulk_over_shear(self) -> float | None:
        """Bulk modulus over shear modulus: `bulk_ratio`, or that of `poisson_ratio` (inf at 0.5); None where `kappa` is given. Of
        an unknown ratio the value at which single runs are made."""
        if self.poisson_ratio is not None:
            return elastic.bulk_ratio(self.poisson_ratio)
        if self.bulk_ratio is None or isinstance(self.bulk_ratio, str):
            return DEFAULT_BULK_RATIO if self.kappa is None else None
        return self.bulk_ratio

    def bulk_modulus(self, shear_modulus: float) -> float:
        """kappa in kPa, for a material of this shear modulus, kPa."""
        if self.kappa is not None:
            return self.kappa
        assert self.bulk_over_shear is not None  # one of the three is always there
        return min(self.bulk_over_shear, LARGEST_BULK_RATIO) * shear_modulus

    def bulk_moduli(self, material: Material) -> float | tuple[float, ...]:
        """kappa of a material, kPa; of the materials of layers those of each, the top one first."""
        return self.bulk_modulus(material.shear_modulus)

    def poisson_ratio_at(self, shear_modulus: float) -> float:
        """Poisson's ratio of a material of this shear modulus, kPa."""
        ratio = self.bulk_over_shear
        return elastic.poisson_ratio(self.bulk_modulus(shear_modulus) / shear_modulus if ratio is None else ratio)

    def shear_modulus_of(self, young: float) -> float:
        """The shear modulus of a material of this Young's modulus, both kPa."""
        if self.kappa is not None:
            return elastic.shear_modulus_beside(young, self.kappa)
        assert self.bulk_over_shear is not None
        return elastic.shear_modulus(young, self.bulk_over_shear)

    def disagreements(self) -> Iterator[tuple[str, str]]:
        given = self.model_fields_set
        if {"model", "energy"} <= given:
            yield "energy", "material.model is given too; keep one of them"
        if not {"model", "energy"} & given:
            yield "model", f"missing; give the {type(self).model_fields['model'].description}; or give material.energy"
        bulk = [name for name in BULK if name in given and dict(self).get(name) is not None]
        if len(bulk) > 1:
            others = " and ".join(f"material.{name}" for name in bulk[:-1])
            yield bulk[-1], f"{others} {'is' if len(bulk) == 2 else 'are'} given too; keep one of them"


class Layer(Section):
    """One layer of the sample; the top layer, which the indenter touches, comes first. The layers stand in place of the table
    [material]."""

    place = "sample.layer"
    rivals = either("model", "energy") | either("bulk_ratio", "poisson_ratio")

    name: Annotated[Line, Field(max_length=40, pattern=r"^[A-Za-z][A-Za-z0-9_]*$")] = Field(
        examples=["skin"],
        description="name of the layer, letters and digits: its parameters are called by it, such as skin.mu",
    )
    thickness: Length = Field(examples=[1.5], description="thickness of the layer; those of all layers add up to sample.thickness")
    interface: Literal["bonded", "sliding"] = Field(
        default="bonded",
        examples=["sliding"],
        description="how the layer lies on the next one: bonded to it, or sliding on it without friction; the layers stay together",
    )
    model: Line | None = Field(default=None, examples=["neo_hookean"], description="material of the layer, as in material.model")
    energy: Line | None = Field(
        default=None, examples=["mu/2*(I1 - 3)"], description="energy instead of a model, as in material.energy"
    )
    parameters: dict[str, Annotated[float | Range, WrapValidator(fixed_or_range)]] = Field(
        default_factory=dict,
        examples=[{"mu": {"start": 10.0, "min": 1.0, "max": 100.0}}],
        description="parameters of the layer's material, each a number, or {start, min, max} to be fitted",
    )
    shared: Annotated[tuple[Line, ...], BeforeValidator(as_tuple)] = Field(
        default=(),
        examples=[["k2_second"]],
        description="parameters of the second family of fibres that are those of the first, as in material.shared",
    )
    bulk_ratio: BulkRatio | None = Field(
        default=None,
        examples=[DEFAULT_BULK_RATIO],
        description="bulk modulus over shear modulus of the layer; left out in all layers it is unknown (20 to 5000), the same in "
        "each; left out beside layers that state theirs it is 1000",
    )
    poisson_ratio: Annotated[float, Field(ge=0, le=0.5, allow_inf_nan=False)] | None = Field(
        default=None,
        examples=[0.45],
        description="Poisson's ratio of the layer, instead of bulk_ratio; for materials without fibres",
    )

    @property
    def choice(self) -> MaterialChoice:
        """The layer's material as the table [material] of a sample of its own."""
        keys = {key: dict(self).get(key) for key in ("model", "energy", "parameters", "shared", "bulk_ratio", "poisson_ratio")}
        if self.bulk_ratio is None and self.poisson_ratio is None:
            keys["bulk_ratio"] = DEFAULT_BULK_RATIO
        return MaterialChoice.model_construct(set(keys), **keys)

    def disagreements(self) -> Iterator[tuple[str, str]]:
        given = self.model_fields_set
        if {"model", "energy"} <= given:
            yield "energy", "the layer's model is given too; keep one of them"
        if not {"model", "energy"} & given:
            yield "model", f"missing; give the {type(self).model_fields['model'].description}; or give an energy"
        if {"bulk_ratio", "poisson_ratio"} <= given and known(self.bulk_ratio, self.poisson_ratio):
            yield "poisson_ratio", "the layer's bulk_ratio is given too; keep one of them"
        if self.bulk_ratio == "unknown":
            yield "bulk_ratio", "must be a number in a layer; fit.uncertain.bulk_ratio can have a prior for all layers"


def layers_disagree(layers: Sequence[Layer], thickness: float) -> Iterator[tuple[str, str]]:
    """(key of [sample], what is wrong) for layers that are called alike, that do not add up to a sample's thickness, mm, or of
    which the last one slides."""
    names = [layer.name for layer in layers]
    if double := next((name for n, name in enumerate(names) if name in names[:n]), None):
        yield "layer", f"two layers are called {double}; give each a name of its own"
    if layers[-1].interface == "sliding":
        yield "layer", f"{layers[-1].name} is the last one, and lies on the base: sample.base says how; remove its interface"
    total = sum(layer.thickness for layer in layers)
    if known(thickness) and abs(total - thickness) > SAME_THICKNESS * thickness:
        parts = " + ".join(f"{layer.thickness:g}" for layer in layers)
        yield "thickness", f"the layers add up to {parts} = {total:.6g} mm; correct sample.thickness, or a layer's"


class LayersChoice(MaterialChoice):
    """The materials of a sample's layers in place of one table [material]; its parameters are called LAYER.PARAMETER."""

    layers: tuple[Layer, ...] = ()

    @classmethod
    def of(cls, layers: Sequence[Layer]) -> LayersChoice:
        """The materials of layers, which were checked before."""
        parameters = {f"{layer.name}.{name}": value for layer in layers for name, value in layer.parameters.items()}
        words = " on ".join(f"{layer.model or layer.energy} ({layer.name})" for layer in layers)
        ratios = {layer.choice.bulk_over_shear for layer in layers}
        ratio = ratios.pop() if len(ratios) == 1 else None
        return cls.model_construct(
            {"parameters"}, model=words, parameters=parameters, layers=tuple(layers), bulk_ratio=ratio, **UNSET
        )

    def with_key(self, key: str, value: Any) -> LayersChoice:
        """The materials with another value of a key in every layer."""
        return LayersChoice.of([layer.with_key(key, value) for layer in self.layers])

    def disagreements(self) -> Iterator[tuple[str, str]]:
        yield from ()  # each layer was checked

    def bulk_moduli(self, material: Material) -> tuple[float, ...]:
        pairs = zip(self.layers, parts_of(material), strict=True)
        return tuple(layer.choice.bulk_modulus(part.shear_modulus) for layer, part in pairs)

    def bulk_modulus(self, shear_modulus: float) -> float:
        """kappa in kPa, of the top layer."""
        return self.layers[0].choice.bulk_modulus(shear_modulus)


UNSET: dict[str, Any] = {**dict.fromkeys(("energy", "kappa", "poisson_ratio", "relaxation")), "shared": ()}
