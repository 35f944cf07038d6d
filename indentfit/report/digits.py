"""The units and digits in which curves are drawn and written: those of the indentfit.digits of their largest numbers."""

from collections.abc import Iterable
from dataclasses import dataclass

from indentfit.axes import INDENTATION, Axes
from indentfit.curve import Curve
from indentfit.digits import Scale, quantity


@dataclass(frozen=True)
class CurveScale:
    """The scales of displacements and forces, or of strains and stresses, of several curves."""

    displacement: Scale
    force: Scale
    axes: Axes = INDENTATION

    @classmethod
    def of(cls, curves: Iterable[Curve]) -> "CurveScale":
        """The scales in which all of the curves can be read."""
        curves = list(curves)
        lengths = [float(value) for curve in curves for value in curve.displacement]
        axes = curves[0].shown if curves else INDENTATION
        forces = [float(value) for curve in curves for value in curve.force]
        return cls(Scale.of(lengths, axes.across_unit), Scale.of(forces, axes.up_unit, digits=5), axes)

    @property
    def across(self) -> str:
        """The label of displacements or strains."""
        return "Strain" if self.axes.across == "strain" else f"Displacement ({self.displacement.symbol})"

    @property
    def up(self) -> str:
        """The label of forces or stresses."""
        return f"{self.axes.up.capitalize()} ({self.force.symbol})"

    def scaled(self, curve: Curve) -> Curve:
        """The numbers of a curve in these units."""
        return Curve(curve.displacement * self.displacement.factor, curve.force * self.force.factor, axes=curve.axes)


def end_words(curve: Curve) -> str:
    """The last point of a curve in words."""
    axes, last = curve.shown, float(curve.displacement[-1])
    at = quantity(last, "mm", 3) if axes.across == "displacement" else f"a strain of {last:.3g}"
    return f"{quantity(float(curve.force[-1]), axes.up_unit)} at {at}"
