"""The table of how the mechanics are solved."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from indentfit.case.quantities import Length, Positive
from indentfit.case.section import Section


class Solver(Section):
    """How the mechanics are solved; the defaults suit every case that was tested."""

    place = "solver"

    assembly: Literal["compiled", "forms"] = Field(default="compiled", description="element loop: compiled, or the slow forms")
    linear: Literal["auto", "pardiso", "superlu", "pyamg"] = Field(default="auto", description="linear solver")
    element: Literal["q1p0", "q2p1"] = Field(
        default="q2p1", description="finite element: eight-node bricks (q1p0) or quadratic ones (q2p1)"
    )
    tolerance: Annotated[float, Field(gt=0, le=0.01, allow_inf_nan=False)] = Field(
        default=1e-3, description="relative residual at equilibrium; what it withholds of the force is added back"
    )
    penalty: Positive = Field(default=1.0, description="factor on the contact stiffness")
    max_step: Length | None = Field(default=None, examples=[0.05], description="largest step of the indenter")
