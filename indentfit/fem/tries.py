"""The tries of a press: what is changed where the usual mesh and contact springs lead to no solution."""

from dataclasses import dataclass

from indentfit.digits import quantity
from indentfit.errors import ConvergenceError, IndentfitError, OutOfTime
from indentfit.fem.deadline import Deadline


@dataclass(frozen=True)
class Try:
    """One try of a press: factors on the usual contact springs, on the width of the elements at the mesh's rim, and on the numbers
    of elements and of steps to the last depth; and whose points follow, where layers slide (fem.facing)."""

    springs: float = 1.0
    rim: float = 1.0
    elements: float = 1.0
    steps: int = 1
    follows: str = ""


USUAL = Try()
# Second tries may take this processor time, s, or this many times that of the first try, where that is longer.
AGAIN_SECONDS, AGAIN_SHARE = 60.0, 1.5
AGAIN_FOLLOWING = 120.0  # the same where layers slide and points follow: whole samples of 200 bricks took 60 to 80 s
MUCH_DEEPER = 1.1  # a curve that ended early is given as on the usual mesh, unless another try got that much deeper
FOLLOWING = (Try(follows="lower"), Try(follows="upper"))  # where layers slide; the steps of such paths take longer
SECOND_TRIES = (Try(rim=2.0), Try(elements=0.5), Try(springs=5.0), Try(springs=5.0, rim=2.0), Try(springs=0.2, rim=2.0))
# On a mesh of more dofs than this a try that takes so many iterations is given up where another mesh may do: the rim of a fine mesh
# under a strip folds up in many small snaps, each of which takes dozens of iterations. A rim as wide as that of a coarse mesh, in
# short steps, often has none.
FINE, FINE_ITERATIONS = 15_000, 150
SECOND_TRIES_FINE = (Try(rim=4.0, steps=3), *SECOND_TRIES)
SECOND_TRIES_ROUND = (Try(springs=5.0), Try(elements=0.5), Try(springs=0.2))
SECOND_TRIES_IN_PLANE = (Try(elements=0.5), Try(springs=3.0), Try(springs=0.3), Try(elements=0.25))


def require_time(deadline: Deadline, first: ConvergenceError) -> None:
    """Raise OutOfTime where no time is left for further tries: with the first try's cause, and its curve."""
    try:
        deadline.check()
    except OutOfTime as error:
        late = OutOfTime(error.limit, f"the first try failed, and others took too long: {first}")
        late.part = first.part
        raise late from first


def known_to(error: IndentfitError, last: float) -> IndentfitError:
    """An error that says how far the curve came where time ran out."""
    if not isinstance(error, OutOfTime) or not error.part:
        return error
    late = OutOfTime(error.limit, f"the curve was known to {quantity(error.part[-1].depth, 'mm', 3)} of {quantity(last, 'mm', 3)}")
    late.part = error.part
    return late
