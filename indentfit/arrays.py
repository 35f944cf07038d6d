"""Names for the types of NumPy arrays, used in annotations everywhere."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.integer]
