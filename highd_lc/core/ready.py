"""Imported once before processes are forked: with its first kernel numba sets up what all kernels need.

That takes a third of a second, which each of the processes would spend for itself.
"""

import numpy as np

from highd_lc.core.kernels import next_uniform

next_uniform(np.zeros(1, np.uint64))
