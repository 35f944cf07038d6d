"""A prediction as text."""

from collections.abc import Iterator

import numpy as np

from indentfit.digits import Scale, plainly, quantity
from indentfit.study.predict import PredictedTest, Prediction

SHOWN = 12  # rows of a test's table
FARTHER = 0.01  # of the largest fitted displacement: what goes no farther beyond it counts as fitted


def prediction_lines(prediction: Prediction) -> Iterator[str]:
    """The forces that a fit predicts, with their bands, line by line."""
    for name, test in prediction.tests.items():
        goes_on = "its misfit goes on from the fitted test" if test.continued else "its misfit is one of its own"
        yield f"predicted {name}: {goes_on}"
        yield from _table(test)
        if _goes_beyond(test) and test.known_to is not None:
            beyond = quantity(test.known_to, test.axes.across_unit, 3).removesuffix(" 1")
            yield f"amber     * beyond {beyond} no force of {name} was fitted: this band is none of 95 %. In half"
            yield "          of its draws the misfit of the law goes on as it ends, in half it bends back; a sample"
            yield "          may do neither, so measure there"
        if test.strained is not None and test.strained > 1 + FARTHER:
            yield f"amber     strains of {name} are {test.strained:.3g} times those of the fitted tests: its band presumes that"
            yield "          the misfit of the law grows in proportion, and is none of 95 %"
    yield f"work      {prediction.runs} sets of parameters; between them the force is known to {prediction.off:.2%}"
    yield "note      bands hold 95 %: of the force by parameters, inputs, the law's misfit and the mesh;"
    yield "          of a measured force also by the noise of the fitted tests"


def _goes_beyond(test: PredictedTest) -> bool:
    return test.known_to is not None and max(map(abs, test.displacement)) > (1 + FARTHER) * test.known_to


def _table(test: PredictedTest) -> Iterator[str]:
    across, up = test.axes.across, test.axes.up
    places = Scale.of(test.displacement, test.axes.across_unit, digits=3)
    forces = Scale.of(test.force, test.axes.up_unit, digits=4)
    of_places = "" if places.unit == "1" else f", {places.unit}"
    rows = [[f"{across}{of_places}", f"{up}, {forces.unit}", f"{up}, 95 %", f"measured {up}, 95 %"]]
    count = len(test.displacement)
    known = np.inf if test.known_to is None else (1 + FARTHER) * test.known_to
    for n in sorted({round(k * (count - 1) / (SHOWN - 1)) for k in range(SHOWN)}):
        mark = "" if abs(test.displacement[n]) <= known else " *"
        force, *ends = (
            f"{forces.factor * values[n]:.4g}"
            for values in (test.force, test.low, test.high, test.measured_low, test.measured_high)
        )
        bands = (f"{low} to {high}{mark}" for low, high in (ends[:2], ends[2:]))
        rows.append([plainly(places.factor * test.displacement[n]), force, *bands])
    widths = [max(len(row[n]) for row in rows) for n in range(len(rows[0]))]
    for row in rows:
        yield "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()
