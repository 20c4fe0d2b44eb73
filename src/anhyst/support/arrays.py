"""The arrays that pass between rooms."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
"""Double precision, of the shape that a docstring states."""
