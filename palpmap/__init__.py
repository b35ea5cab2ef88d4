"""The application: study files, command line, recording, report."""

import os

from palpmap.version import __version__ as __version__

# numpy's own threads (OpenBLAS) go on spinning after each product, on the core that the sparse
# solver's next step waits for: on two cores everything took 1.8 times as long. Read when numpy is
# loaded, which comes later.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
