"""The table of a free map's spots, as a terminal of 80 columns shows it."""

import io

import numpy as np
from rich.console import Console

from identify.fit import Spot
from palpmap.report.draw import console
from palpmap.result.field_tables import _spot_table


def test_no_word_of_the_table_of_spots_is_cut_in_a_terminal_of_80_columns():
    size = {"diameter_lower95_m": 0.008, "diameter_upper95_m": 0.012}
    spots = [
        Spot(-0.0384, 0.0398, -0.0574, 3e-4, 0.01, 0.01, 24.03, 11.58, 51.24, 0.999, 0.9, **size),
        Spot(-0.0192, 0.1436, -0.1574, 2e-3, 0.01, 0.01, 0.7, 0.17, 2.35, 0.6, 0.9,
             **(size | {"diameter_lower95_m": 0.0})),
        Spot(-0.0192, 0.1436, -0.1574, 2e-3, 0.01, 0.01, 0.7, 0.17, 2.35, 0.6, 0.9),
    ]  # fmt: skip
    out = io.StringIO()
    Console(file=out, width=80).print(console(_spot_table(spots, True, np.zeros(3))))
    hard, soft, old = (line.split() for line in out.getvalue().splitlines()[-4:-1])
    assert hard[:5] == ["hard", "-38.4,", "39.8,", "-57.4", "0.3"]
    assert hard[5:] == ["8", "to", "12", "24", "(12", "to", "51.2)", ">", "0.99"]
    assert soft[5:] == ["at", "most", "12", "0.7", "(0.17", "to", "2.35)", "0.60"]
    assert old[5:] == ["10", "0.7", "(0.17", "to", "2.35)", "0.60"]  # of a file without interval
    assert "Probability" in out.getvalue()
    assert "+- mm" in out.getvalue()
