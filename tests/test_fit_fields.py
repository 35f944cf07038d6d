"""The stresses at the optimum of a fit, made while the fit goes on."""

import pytest
from fixtures.cases import straight_curve, tiny_case

from indentfit.errors import Stopped
from indentfit.experiment.measured import read_case
from indentfit.report import fit_fields
from indentfit.report.fit_fields import FitFields

FOUND, MOVED = {"mu": 1.0, "zeta": 2.0, "phi": 1.0}, {"mu": 1.5, "zeta": 2.0, "phi": 1.0}


@pytest.fixture
def case(tmp_path):
    for name in ("parallel", "perpendicular"):
        straight_curve(tmp_path / f"{name}.csv", 20)
    return read_case(tiny_case(tmp_path))


@pytest.fixture
def work(monkeypatch):
    """The points at which stresses are drawn."""
    drawn = []
    monkeypatch.setattr(fit_fields, "draw_stresses", lambda folder, case, point, refined: drawn.append((point, refined)))
    return drawn


def test_stresses_that_are_begun_are_those_of_the_result_but_for_its_digits(case, work, tmp_path):
    with FitFields(tmp_path / "fields") as fields:
        fields.begin(case, FOUND)
        fields.begin(case, {**FOUND, "mu": 1.0 + 1e-12})
        assert fields.ended() is None
    assert work == [(FOUND, None)]


@pytest.mark.parametrize(("point", "refined"), [(MOVED, None), (FOUND, 1.5)])
def test_an_optimum_that_has_moved_or_has_a_finer_mesh_has_its_own_stresses(case, work, tmp_path, point, refined):
    with FitFields(tmp_path / "fields") as fields:
        fields.begin(case, FOUND)
        fields.begin(case, point, refined)
        fields.ended()
    assert work == [(point, refined)]


def test_a_process_of_its_own_gives_up_the_stresses_of_an_earlier_optimum(case, tmp_path):
    """What is left is the files of the second point: in the first process nothing is waited for."""
    with FitFields(tmp_path / "apart", apart=True) as fields:
        fields.begin(case, FOUND)
        fields.begin(case, MOVED)
        assert fields.ended() is None
    assert fit_fields.draw_stresses(tmp_path / "here", case, MOVED, None) is None
    names = sorted(path.name for path in (tmp_path / "here").iterdir())
    assert names == sorted(path.name for path in (tmp_path / "apart").iterdir()) and "pictures.json" in names
    for name in names:
        if not name.endswith(".png"):
            assert (tmp_path / "apart" / name).read_bytes() == (tmp_path / "here" / name).read_bytes()


def test_a_fit_that_is_stopped_ends_the_process(case, tmp_path):
    with pytest.raises(Stopped, match="by Ctrl-C"), FitFields(tmp_path / "fields", apart=True) as fields:
        fields.begin(case, FOUND)
        raise Stopped("stopped by Ctrl-C", 2)
