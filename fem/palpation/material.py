"""The material of a body for one evaluation."""

from typing import NamedTuple

import numpy as np

from fem.linear.modulus_samples import QuadraticModulus
from fem.palpation.fibres import Fibres
from fem.palpation.skin import Skin


class Material(NamedTuple):
    """Material of a body: modulus samples of the stiffness matrix (p,), fibres, skin.

    `close` has the modulus samples that count in the cells around the tips, `local` (j,) the
    modulus at the contact points.
    """

    modulus: np.ndarray
    fibres: Fibres | None
    skin: Skin | None
    close: QuadraticModulus
    local: np.ndarray
