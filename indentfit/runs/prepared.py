"""What every worker needs, imported and loaded once by the server that workers are forked from (runs/start.py).

The module solves one small problem, so that the compiled element loop and the solver's library are loaded too. No run depends on
it: a run's numbers are the same in a process that was spawned. A failure here is left to the workers, which meet it again and can
say it.
"""

import contextlib
import gc


def _rehearse() -> None:
    """One shallow indentation of a few bricks, with a sensitivity."""
    from indentfit.case.tables import Indenter, Mesh, Sample, Solver
    from indentfit.fem.ahead import compile_ahead
    from indentfit.fem.setup import Press, Setup

    sample = Sample(shape="block", length=4.0, width=4.0, thickness=1.0, base="sliding")
    indenter = Indenter(shape="strip", width=2.0, length=8.0, edge_radius=0.2, friction=0.0)
    setup = Setup(sample, indenter, Mesh(elements=20), Solver(), 0.1)
    compile_ahead(setup)  # before the other imports, because this may take seconds of another process
    import numpy as np
    from threadpoolctl import threadpool_limits

    from indentfit.fem.simulate import Model
    from indentfit.material import typed
    from indentfit.runs.bench import FIRST

    model = Model(setup)
    gel = typed(FIRST, ["mu"])(mu=1.0)
    with threadpool_limits(1):
        model.stiffness(gel, 100.0, 0)
        model.run(Press(gel, 100.0, 0.0, np.array([0.02]), sensitivities=("mu",)))


gc.disable()  # imports leave little garbage, and their collections take a tenth of their time
with contextlib.suppress(Exception):
    _rehearse()
gc.enable()
gc.collect()
gc.freeze()  # a collection in a worker then leaves the shared pages as they are
