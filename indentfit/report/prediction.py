"""A prediction as text."""

from collections.abc import Iterator

import numpy as np

from indentfit.digits import plainly
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
            yield f"amber     * beyond {plainly(test.known_to)} no force of {name} was fitted: this band is none of 95 %. In half"
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
    rows = [["displacement", "force", "force, 95 %", "measured force, 95 %"]]
    count = len(test.displacement)
    known = np.inf if test.known_to is None else (1 + FARTHER) * test.known_to
    for n in sorted({round(k * (count - 1) / (SHOWN - 1)) for k in range(SHOWN)}):
        rows.append(
            [
                plainly(test.displacement[n]),
                f"{test.force[n]:.4g}",
                f"{test.low[n]:.4g} to {test.high[n]:.4g}{'' if abs(test.displacement[n]) <= known else ' *'}",
                f"{test.measured_low[n]:.4g} to {test.measured_high[n]:.4g}{'' if abs(test.displacement[n]) <= known else ' *'}",
            ]
        )
    widths = [max(len(row[n]) for row in rows) for n in range(len(rows[0]))]
    for row in rows:
        yield "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()
