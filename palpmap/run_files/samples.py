"""samples.parquet: every time step of a robot's presses."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from sim.scan import Series

FILE = "samples.parquet"


def write_samples(samples: "Sequence[Series]", path: Path) -> None:
    """Write every time step of the presses, as the robot reads them, into a Parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    from sim.scan import SERIES_PHASES

    def column(name: str) -> np.ndarray:
        return np.concatenate([getattr(one, name) for one in samples])

    table = {
        "press": column("press"),
        "time_s": column("time_s"),
        "phase": pa.DictionaryArray.from_arrays(column("phase").astype(np.int8), SERIES_PHASES),
        "force_n": column("force_n").astype(np.float32),
        "displacement_m": column("displacement_m").astype(np.float32),
        "wanted_n": column("wanted_n").astype(np.float32),
    }
    for joint, angles in enumerate(column("q").T, start=1):
        table[f"joint{joint}_rad"] = angles.astype(np.float32)
    pq.write_table(pa.table(table), path, compression="zstd")
