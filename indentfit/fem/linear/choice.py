"""Which library solves the linear systems: the case's wish, or what is installed and pays at the size of the mesh."""

import contextlib
import os

from indentfit.errors import InputError
from indentfit.fem.linear import pardiso

# Dofs from which multigrid needs less time and memory: than PARDISO, and than SuperLU.
LARGE, LARGE_WITHOUT_PARDISO = 150_000, 20_000


def choice(kind: str, n_dofs: int = 0) -> str:
    """Name of the library that a wish stands for.

    Parameters
    ----------
    kind : "auto", "pardiso", "superlu" or "pyamg"
        "auto" is PARDISO where it is installed, else SuperLU; pyamg for large meshes.
    n_dofs : int

    Raises
    ------
    InputError
        For "pardiso" where it is not installed.
    """
    if kind not in ("auto", "pardiso"):
        return kind
    os.getcwd()  # raises where the working folder is gone: MKL ends the process there
    with contextlib.suppress(ImportError, OSError):
        pardiso.load()
        return "pyamg" if kind == "auto" and n_dofs > LARGE else "pardiso"
    if kind == "pardiso":
        raise InputError('solver.linear = "pardiso": pypardiso is not installed here; use "auto" or "superlu"')
    return "pyamg" if n_dofs > LARGE_WITHOUT_PARDISO else "superlu"
