"""What every export needs: the body's mesh, where it is held, and its moduli."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fem import Mesh, PalpationModel
from identify.body import ChangedMap
from identify.catalogue import CATALOGUE
from identify.residual import changed_map
from palpmap.results import Run
from palpmap.units import is_of_map

GRID_CELLS = 48  # along the longest edge
LEAST = 0.01  # of the background: a soft inclusion's sum may come out at or below zero


@dataclass(frozen=True, eq=False)
class ExportedBody:
    """The body of a run with its fitted map.

    Attributes
    ----------
    run : the run folder, read back
    model : finite elements of the fit, in the body's frame
    origin_m : (3,) where the body's frame stands in the scan's; exports are in the scan's
    """

    run: Run
    model: PalpationModel
    origin_m: np.ndarray

    @classmethod
    def of(cls, run: Run) -> ExportedBody:
        """Mesh the body of a run as its fit did."""
        opened = run.experiment.opened(thin=False)
        return cls(run, opened.body.coarse, np.asarray(opened.origin_m, float))

    @property
    def mesh(self) -> Mesh:
        """Ten nodes a cell, in the body's frame."""
        return self.model.mesh

    @property
    def poisson_ratio(self) -> float:
        """Poisson's ratio of the whole body."""
        return self.model.stiffness.poisson_ratio

    @property
    def held(self) -> np.ndarray:
        """Numbers of the nodes of the base and of held sides."""
        support = self.model.support
        names = (support.surface, *support.held)
        return np.unique(np.concatenate([self.mesh.surface_nodes(name) for name in names]))

    def modulus(self, points_m: np.ndarray) -> np.ndarray:
        """Young's modulus (p,) in Pa at points (p, 3) of the body's frame; never below `LEAST`."""
        least = LEAST * self.run.fit.map.background_pa
        return np.maximum(self._map[0].modulus(points_m), least)

    @cached_property
    def _map(self) -> tuple[ChangedMap, tuple[str, ...]]:
        """The map as its effects have changed it (an edge, a gradient), and the names of these."""
        return changed_map(self.run.fit, self.mesh.box_m, CATALOGUE)

    @property
    def cell_modulus(self) -> np.ndarray:
        """Young's modulus (e,) in Pa at the middle of each cell."""
        return self.modulus(self.mesh.nodes[self.mesh.cells[:, :4]].mean(axis=1))

    def grid(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return an even grid over the body.

        Returns
        -------
        start_m : (3,) first point, in the body's frame
        step_m : (3,) between neighbours
        points : (3,) number of points along x, y, z
        """
        low, high = self.mesh.box_m
        size = high - low
        cells = np.maximum(np.round(GRID_CELLS * size / size.max()).astype(int), 4)
        return low, size / cells, cells + 1

    @property
    def left_out(self) -> list[str]:
        """Sentences about what an export as an elastic body does not hold."""
        study, said = self.run.experiment.study, []
        of_fit = (
            name.rpartition(".")[0] for name in self.run.fit.parameters if not is_of_map(name)
        )
        effects = [name for name in dict.fromkeys(of_fit) if name not in self._map[1]]
        if effects:
            said.append(f"Map and body are exported, and of the model not: {', '.join(effects)}.")
        if study.body.support != "base-bonded":
            said.append(f"The base is exported as bonded; in the study it is {study.body.support}.")
        return said
