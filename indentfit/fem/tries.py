"""The tries of a press: what is changed where the usual mesh and contact springs lead to no solution."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Try:
    """One try of a press: factors on the usual contact springs, on the width of the elements at the mesh's rim, and on the numbers
    of elements and of steps to the last depth."""

    springs: float = 1.0
    rim: float = 1.0
    elements: float = 1.0
    steps: int = 1


USUAL = Try()
# Second tries may take this processor time, s, or this many times that of the first try, where that is longer.
AGAIN_SECONDS, AGAIN_SHARE = 60.0, 1.5
MUCH_DEEPER = 1.1  # a curve that ended early is given as on the usual mesh, unless another try got that much deeper
SECOND_TRIES = (Try(rim=2.0), Try(elements=0.5), Try(springs=5.0), Try(springs=5.0, rim=2.0), Try(springs=0.2, rim=2.0))
# On a mesh of more dofs than this a try that takes so many iterations is given up where another mesh may do: the rim of a fine mesh
# under a strip folds up in many small snaps, each of which takes dozens of iterations. A rim as wide as that of a coarse mesh, in
# short steps, often has none.
FINE, FINE_ITERATIONS = 15_000, 150
SECOND_TRIES_FINE = (Try(rim=4.0, steps=3), *SECOND_TRIES)
SECOND_TRIES_ROUND = (Try(springs=5.0), Try(elements=0.5), Try(springs=0.2))
SECOND_TRIES_IN_PLANE = (Try(elements=0.5), Try(springs=3.0), Try(springs=0.3), Try(elements=0.25))
