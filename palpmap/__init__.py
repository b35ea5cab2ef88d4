"""The application: study files, command line, recording, report."""

import os

__version__ = "0.1.0"

# numpy's own threads (OpenBLAS) go on spinning after each product, on the core that the sparse
# solver's next step waits for: on two cores everything took 1.8 times as long. Read when numpy is
# loaded, which comes later.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
