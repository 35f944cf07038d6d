"""The first compilation of the element loops, in two processes."""

import os
import sys
import time

import numpy as np
import pytest
from fixtures.cases import white_matter

from indentfit import compiled, machine
from indentfit.fem.ahead import PLANE, compile_tangent
from indentfit.fem.element import loops_of
from indentfit.fem.meridian import LOOPS
from indentfit.fem.setup import Press
from indentfit.fem.simulate import Model
from indentfit.runs.points import setup_of

ROUND = ("indenter={shape='sphere',radius=2,friction=0.3}", "material={model='neo_hookean',bulk_ratio=1000,parameters={mu=1.0}}")
KINDS = {PLANE: (*ROUND, "test=[{name='a',depth=0.1,points=2}]"), "q2p1": (), "q1p0": ("solver.element=q1p0",)}


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_compiled_ahead_is_what_a_run_calls(kind):
    """Another type of one argument would have the tangent compiled once more, in the run."""
    tangent = LOOPS.tangent if kind == PLANE else loops_of(kind).tangent
    compile_tangent(kind)
    before = tangent.signatures
    case = white_matter("mesh.elements=20", "solver.assembly=compiled", *KINDS[kind])
    model = Model(setup_of(case))
    assert model.setup.in_plane == (kind == PLANE)
    model.run(Press(case.law(**case.start_values()), 1000.0, 0.0, np.array([0.02])))
    assert tangent.signatures == before


def test_compiled_code_is_stored_until_its_source_changes(tmp_path, monkeypatch):
    source = tmp_path / "source.py"
    source.write_text("def twice(x):\n    return 2 * x\n")
    monkeypatch.syspath_prepend(tmp_path)
    from source import twice

    known = compiled.compiled()(twice)
    assert not compiled.is_stored(known)
    assert known(3.0) == 6.0
    assert compiled.is_stored(known)
    later = time.time() + 10
    os.utime(source, (later, later))
    assert not compiled.is_stored(known)
    assert compiled.is_stored(twice)  # never compiled


def test_another_process_shares_the_modules_and_is_waited_for(tmp_path, monkeypatch):
    monkeypatch.setattr(machine, "cores", lambda: 2)
    (tmp_path / "written.py").write_text("WORD = 'there'\n")
    monkeypatch.syspath_prepend(tmp_path)
    path = tmp_path / "said.txt"
    code = f"import written; open({str(path)!r}, 'w').write(written.WORD)"
    with machine.python_beside(code):
        pass
    assert path.read_text() == "there"
    path.unlink()
    monkeypatch.setattr(sys, "executable", "/opt/program/with_python_inside")
    with machine.python_beside(code):
        pass
    assert not path.exists()
