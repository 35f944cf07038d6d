"""Measured displacements as tests of their own: each field is a curve of displacements over the numbers of its components.

The run of the indentation brings them beside the force, so that such a test needs no run. Its weight is that of its standard
deviations beside the noise of the measured curves, so that the sum of squares weighs all residuals by their variances.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from indentfit.axes import MOTION
from indentfit.case.measured_field import known_points
from indentfit.case.messages import Fault, line
from indentfit.case.prior_tests import weight_of
from indentfit.case.tables import Test
from indentfit.curve import Curve
from indentfit.displacements import Displacements, averaged
from indentfit.errors import CaseError

if TYPE_CHECKING:
    from indentfit.case.measured_field import MeasuredField
    from indentfit.case.whole import Case

FIELD: Literal["field"] = "field"


class FieldTest(Test):
    """The displacements that were measured in an indentation, as a test that needs no run.

    Parameters
    ----------
    of : str
        The name of the indentation.
    """

    kind: Literal["field"] = FIELD  # type: ignore[assignment]  # no kind that a case can ask for
    of: str = ""

    @property
    def displacements(self) -> Displacements:
        """The measured displacements, with standard deviations and depths for all."""
        return self.field[0].points


def with_field_tests(case: Case) -> Case:
    """The case with a test for each measured field behind the others; the case itself where there is none.

    Raises
    ------
    CaseError
        The fit does not weigh squares.
    """
    made = [(n, field) for n, test in enumerate(case.tests) for field in test.field if not isinstance(test, FieldTest)]
    if not made:
        return case
    if case.fit.method != "least_squares":
        text = 'displacements are weighed by their standard deviations in a sum of squares: set fit.method = "least_squares"'
        raise CaseError([line(case.path, Fault(("fit", "method"), case.fit.method, text))])
    if case.fit.posterior:
        text = "is not drawn of displacements yet; take the fields out, or set fit.posterior = false"
        raise CaseError([line(case.path, Fault(("fit", "posterior"), True, text))])
    pairs = [_made(case, n, field) for n, field in made]
    tests, curves = zip(*pairs, strict=True)
    return case.model_copy(update={"tests": (*case.tests, *tests), "curves": (*case.curves, *curves)})


def _made(case: Case, n: int, field: MeasuredField) -> tuple[FieldTest, Curve]:
    """The test and the curve of a field of the test number n."""
    test = case.tests[n]
    sample = case.sample_of(test)
    (points,) = known_points([field], float(case.outputs(test)[-1]), sample.geometry.outline, float(sample.thickness))
    groups = points.groups
    values, sd = averaged(points, groups)
    curve = Curve(np.arange(1.0, values.size + 1), values, sd=sd, axes=MOTION)
    name = f"{test.name}: {field.label}"
    keys = {**dict(Test(name=name, depth=1.0)), "depth": None, "weight": weight_of(case, curve, sd), "synthetic": test.synthetic}
    whole = field.model_copy(update={"file": points})
    return FieldTest.model_construct(**{**keys, "kind": FIELD, "curve": points.file, "field": (whole,), "of": test.name}), curve
