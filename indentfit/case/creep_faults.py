"""What is wrong with a test whose rig holds the force."""

from __future__ import annotations

from collections.abc import Iterator

from indentfit.case.messages import MISSING, Fault
from indentfit.case.tables import Test
from indentfit.curve import Curve

CREEP = {
    "curve": "creep needs the times of the curve: add a column time_s to its file, or control the displacement",
    "force": "missing; creep needs the force that is held (force, mN), or a measured curve with a column time_s",
    "ramp": "missing; give the duration of the ramp to the force that is held (ramp, s)",
    "rate": "is a velocity, which a held force does not have; give the duration of the ramp to the force (ramp, s)",
}


def faults_of_creep(label: str, test: Test, curve: Curve | None) -> Iterator[Fault]:
    """Faults of a test whose rig holds the force, and of a force where the rig does not."""
    if test.control != "force":
        if test.force is not None:
            yield Fault(("test", label, "force"), test.force, 'needs control = "force"; add it, or remove this key')
    elif curve is not None and test.force is not None:
        yield Fault(("test", label, "force"), test.force, "the curve tells the force that is held; remove this key")
    elif curve is not None and curve.time is None:
        yield Fault(("test", label, "control"), test.control, CREEP["curve"])
    elif curve is None and test.rate is not None:
        yield Fault(("test", label, "rate"), test.rate, CREEP["rate"])
    elif curve is None and not (test.curve or test.record):
        for key in ("force", "ramp"):
            if key not in test.model_fields_set:
                yield Fault(("test", label, key), MISSING, CREEP[key])
