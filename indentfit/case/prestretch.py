"""Faults of a sample that is stretched before the indentation, in tests and tables that do not go with it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from indentfit.case.messages import MISSING, Fault

if TYPE_CHECKING:
    from indentfit.case.faults import Parts


def faults_of_prestretch(parts: Parts) -> Iterator[Fault]:
    """Faults where fibres do not lie along the stretch, or a table has no solution for a stretched sample."""
    common = getattr(parts.sample, "prestretch", None)
    stretched = [test for test in parts.tests if test is not None and (common or dict(test.sample or {}).get("prestretch"))]
    if not stretched:
        return
    for test in stretched:
        for key in ("angle", "dip"):
            if getattr(test, key):
                text = "must be 0 where the sample has a prestretch: it is stretched along its fibres; or remove the prestretch"
                yield Fault(("test", test.name, key), getattr(test, key), text)
        if getattr(test, "field", None):
            text = "is not compared where the sample has a prestretch; remove it, or the prestretch"
            yield Fault(("test", test.name, "field"), MISSING, text)
    if parts.sample is not None and parts.sample.fibre_angle:
        text = "must be 0 where sample.prestretch is given: the sample is stretched along its fibres"
        yield Fault(("sample", "fibre_angle"), parts.sample.fibre_angle, text)
    uncertain = parts.fit.uncertain if parts.fit is not None else None
    if uncertain is not None and uncertain.fibre_angle is not None:
        text = "cannot be fitted where sample.prestretch is given: the sample is stretched along its fibres; remove one of the two"
        yield Fault(("fit", "uncertain", "fibre_angle"), uncertain.fibre_angle.model_dump(), text)
    if parts.material is not None and parts.material.relaxation is not None:
        text = "is not solved for a material that relaxes; remove it, or [material.relaxation]"
        yield Fault(("sample", "prestretch"), common, text)
