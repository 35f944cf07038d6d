"""SuperLU, which SciPy brings: slower than PARDISO and on every machine. Its factor includes the contact that it was made with."""

import scipy.sparse.linalg as spla

from indentfit.fem.linear.direct import DirectFactor, DirectFactoriser
from indentfit.fem.linear.tangent import Tangent


class SuperLU(DirectFactoriser):
    """Factors of whole tangents."""

    name = "superlu"

    def factorize(self, tangent: Tangent) -> DirectFactor:
        """Raises RuntimeError where the matrix is singular."""
        options = {"SymmetricMode": True}
        lu = spla.splu(tangent.whole.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options=options)
        return DirectFactor(tangent.bulk, tangent.dilatation, lambda _: lambda r: lu.solve(r.T).T)

    def sharper(self) -> None:
        """None: its factors are in double precision."""
        return None
