"""Imported before numpy: its linear algebra runs in one thread, unless the environment says otherwise.

Workers are processes, one a core. Threads of theirs would wait for each other, and sums would be split by how many
cores a machine has: other last bits.
"""

import os

for _name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"):
    os.environ.setdefault(_name, "1")
