"""What every test needs: one thread per numerical library, and the fixtures of the package `fixtures` beside this file."""

import os

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # the numerical libraries read it when they are loaded

pytest_plugins = ["fixtures.cases", "fixtures.drawing"]
