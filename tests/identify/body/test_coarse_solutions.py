"""Solutions that are kept for the fits that begin at the end of others."""

from fem import PalpationModel
from identify.body import coarse_solutions
from identify.body.coarse_solutions import CoarseSolutions, fewer
from identify.body.mechanics import BodyMechanics
from identify.map.gaussian_map import GaussianMap
from tests.identify.select.loop_problem import uncorrected


def test_of_many_presses_fewer_solutions_are_kept_but_two(monkeypatch):
    assert [fewer(6, size) for size in (15e6, 45e6, 1e9)] == [6, 3, 2]
    own = uncorrected()
    model: PalpationModel = own.coarse
    state = BodyMechanics(model, None, own.at_poisson_ratio).state()
    for memory, kept in ((1e9, 6), (1.0, 2)):
        monkeypatch.setattr(coarse_solutions, "_KEPT_BYTES", memory)
        solutions = CoarseSolutions(model)
        for step in range(8):
            last = solutions.solved(GaussianMap(5000.0 + step), state)
            assert last.sensitivity.any()
        assert len(solutions._solutions) == kept
        assert list(solutions._solutions.values())[-1] is last
        # Of large ones the derivatives are freed, too, but those of the last one
        assert solutions.solved(GaussianMap(5006.0), state).sensitivity.any()
        held = ["sensitivity" in vars(one) for one in solutions._solutions.values()]
        assert held == ([True] * 6 if kept == 6 else [False, True])
