"""A problem is posed from a map that the model can evaluate."""

from dataclasses import replace

import numpy as np
import pytest
from loop_problem import SIZE, TRUE, model, points, scan, timing, true_compliance

from identify.gaussian_map import GaussianMap, Inclusion
from identify.optimize_result import InadmissibleError
from identify.parameter_space import parameter_space
from palpmap.problem import possible_map


def test_a_map_finer_than_the_mesh_is_weakened_until_it_can_be_evaluated():
    press, _, _, force = timing(3)
    x, y, z = points()[12] + [0.001, 0.001, -0.001]
    spike = GaussianMap(5000.0, (Inclusion(3e7, x, y, z, 0.002),))
    box = np.array([[0.0, 0.0, 0.0], SIZE])
    known = model(scan(true_compliance()[press] * force, force, 3))
    own = replace(known, space=parameter_space(spike, box))
    with pytest.raises(InadmissibleError, match="finer than the mesh"):
        own.linearise(own.start(spike))
    weaker = possible_map(own, spike)
    own.linearise(own.start(weaker))
    assert weaker.inclusions[0].weight_pa < spike.inclusions[0].weight_pa
    assert possible_map(known, TRUE) is TRUE
