"""How many threads a process of linear algebra takes: one, so that results do not depend on how busy a machine is.

How a sum is shared among threads changes its last bits. What runs side by side here are processes.
"""

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment of a process, to be set before numpy is loaded; what an operator has set stays."""
