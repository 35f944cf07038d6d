"""Gelatin records of a real rig (../shared/data, not part of the project): what issue 3 asks of them."""

import numpy as np
import pytest
from fixtures.cases import SHARED, tiny_case
from scipy.interpolate import PchipInterpolator

from indentfit.case import Record, RecordChannel
from indentfit.experiment.measured import read_case
from indentfit.experiment.processed import process_record
from indentfit.experiment.reading import read_record
from indentfit.inference.fit import fit

RECORDS = SHARED / "data"
pytestmark = pytest.mark.skipif(not (RECORDS / "phantom_1_raw.csv").exists(), reason="../shared/data is not here")
LAYOUT = Record(
    displacement=RecordChannel(column="displacement_V", gain=6.0, sign=-1, unit="mm"),
    force=RecordChannel(column="force_V", gain=24.0, sign=-1, unit="mN"),
    rate=1000.0,
)
THICKNESS = {1: 5.79, 2: 6.52}  # mm
PUBLISHED = {1: (56.7, 24.6, 5.577 / 6.058), 2: (45.6, 24.4, 4.222 / 4.59)}  # slope mN/mm, peak mN, Ginf / G0
HAYES = PchipInterpolator([0.0, 0.2, 0.4, 0.6], [1.0, 1.281, 1.684, 2.213])  # bonded, nu = 0.5 (Hayes et al. 1972), over a / h


@pytest.fixture(scope="module", params=[1, 2])
def phantom(request):
    record = read_record(RECORDS / f"phantom_{request.param}_raw.csv", LAYOUT)
    return request.param, process_record(record, THICKNESS[request.param])


def test_a_phantom_has_its_slope_velocity_and_peak(phantom):
    number, done = phantom
    slope, peak, _ = PUBLISHED[number]
    assert done.line.slope == pytest.approx(slope, rel=0.03)
    assert done.peak == pytest.approx(peak, rel=0.02)
    assert 0.96 <= done.velocity <= 1.20
    assert done.contact.uncertainty < {1: 0.005, 2: 0.04}[number]  # the second begins to rise before the ramp is straight


def test_a_phantom_relaxes_by_its_published_ratio(phantom):
    number, done = phantom
    assert done.relaxation.ratio == pytest.approx(PUBLISHED[number][2], abs=0.02)


def phantom_case(folder, number, elements, parameters, relaxation=None):
    """The case file of a phantom's raw record."""
    return tiny_case(
        folder,
        sample={"diameter": 20.0, "thickness": THICKNESS[number], "base": "bonded"},
        indenter={"shape": "cylinder", "diameter": 2.0, "friction": "stick", "width": None, "length": None},
        mesh={"elements": elements},
        solver=None,
        material={"parameters": parameters, **({"relaxation": relaxation} if relaxation else {})},
        record={
            "rate": 1000.0,
            "displacement": {"column": "displacement_V", "gain": 6.0, "sign": -1, "unit": "mm"},
            "force": {"column": "force_V", "gain": 24.0, "sign": -1, "unit": "mN"},
        },
        test=[{"name": "ramp", "angle": 0, "record": str(RECORDS / f"phantom_{number}_raw.csv")}],
    )


@pytest.mark.parametrize(
    ("number", "elements"),
    [(1, 200), pytest.param(1, 400, marks=pytest.mark.campaign), pytest.param(2, 400, marks=pytest.mark.campaign)],
)
def test_mu_fitted_to_the_raw_record_is_that_of_hayes_factor(number, elements, tmp_path):
    """mu within 5 % of F (1 - nu) / (4 a w k): the fit sees the whole curve, the formula its end, 7 to 8 % deep.

    At 200 elements the forward model is 4 % too stiff at small strain, at 400 half a percent.
    """
    record = RECORDS / f"phantom_{number}_raw.csv"
    case = phantom_case(tmp_path, number, elements, {"mu": {"start": 5.0, "min": 1.0, "max": 20.0}})
    result = fit(read_case(case))
    done = process_record(read_record(record, LAYOUT))
    hayes = done.peak / done.depth * 0.5 / (4 * 1.0 * float(HAYES(1 / THICKNESS[number])))
    assert result.success
    assert result.parameters["mu"].value == pytest.approx(hayes, rel=0.05)
    assert np.isclose(hayes, 5.7 if number == 1 else 4.6, rtol=0.03)  # by hand, with k = 1.236 and 1.205


@pytest.mark.campaign
@pytest.mark.parametrize("terms", [1, 2, 3])
@pytest.mark.parametrize("number", [1, 2])
def test_ramp_and_hold_in_one_fit_relax_by_the_published_ratio(number, terms, tmp_path):
    """The published series is one of the hold alone; more terms find more that relaxed in the ramp, and one term less."""
    case = phantom_case(tmp_path, number, 400, {"mu": {"start": 5.0, "min": 1.0, "max": 20.0}}, {"terms": terms})
    result = fit(read_case(case, ["fit.profiles=false"]))
    known = result.moduli["Ginf_G0"]
    assert known.value == pytest.approx(PUBLISHED[number][2], abs={1: 0.03, 2: 0.01, 3: 0.025}[terms])
    assert {name: round(size.relative, 2) for name, size in result.misfit.items()}["ramp (hold)"] <= 0.02
