"""The body as a MuJoCo flex, each tetrahedron with its own modulus.

MuJoCo's tetrahedra have four nodes: near-incompressible ones are far too stiff. The body is
therefore exported with a Poisson's ratio of at most `LARGEST_POISSON`, on a mesh of its own, and
with one factor on all moduli that makes the largest difference from the fit's compliance under the
scan's presses least. The map's proportions are kept.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np

from fem import Mesh, PalpationModel, block_mesh
from fem.contact import contact_weights
from models import InputError, kinds_checked, replaced
from palpmap.export.body import ExportedBody

if TYPE_CHECKING:
    from mujoco import MjModel  # pyright: ignore[reportAttributeAccessIssue]

LARGEST_POISSON = 0.4
CELL = 0.9  # of the tip's radius
MOST_CELLS = 28  # along an edge of a block
GRADING = 1.5
DENSITY = 1000.0  # kg/m^3
TIME_STEP_S, DAMPING = 0.004, 0.02


@dataclass(frozen=True)
class Agreement:
    """How the exported body answers the scan's presses, by its own linear elements.

    Attributes
    ----------
    factor : on all moduli
    poisson_ratio : of the exported body
    largest : largest relative difference of a press's compliance from the fit's
    """

    factor: float
    poisson_ratio: float
    largest: float


def write_mujoco(body: ExportedBody, path: Path) -> Agreement:
    """Write an MJCF file and, beside it, the moduli of its elements (.npz).

    The .npz holds `vertices_m`, `elements`, `modulus_pa` (e,) as exported, `map_pa` (e,) of the
    map, `weights` (j, v, 3), forces on the vertices under 1 N of each press, `compliance_m_per_n`
    (j,) of the fit: `weights[j] * force` repeats press j.
    """
    mesh, fit = _mesh(body), body.run.fit
    nu = min(body.poisson_ratio, LARGEST_POISSON)
    model = PalpationModel(
        mesh, nu, body.model.contacts, near_field=False, support=body.model.support
    )
    own = model.evaluate(body.modulus(model.points_m)).compliance
    ratio = own / fit.compliance_m_per_n
    factor = float(np.sqrt(ratio.min() * ratio.max()))  # the least largest difference
    middle = mesh.nodes[mesh.cells].mean(axis=1)
    in_map = body.modulus(middle)
    names = (body.model.support.surface, *body.model.support.held)
    held = np.unique(np.concatenate([mesh.surface_nodes(name) for name in names]))
    vertices = mesh.nodes + body.origin_m
    with replaced(path.with_suffix(".npz")) as beside, beside.open("wb") as file:
        np.savez_compressed(
            file,
            vertices_m=vertices,
            elements=mesh.cells,
            modulus_pa=factor * in_map,
            map_pa=in_map,
            weights=contact_weights(mesh, model.contacts).astype(np.float32),
            compliance_m_per_n=fit.compliance_m_per_n,
        )
    with replaced(path) as beside:
        mjcf = _mjcf(body, mesh, vertices, held, nu, factor * float(in_map[0]))
        beside.write_text(mjcf, encoding="utf-8")
    return Agreement(factor, nu, float(np.abs(ratio / factor - 1).max()))


@kinds_checked
def load_mujoco(path: str | os.PathLike[str]) -> MjModel:
    """Compile an exported MJCF file and give each element its modulus.

    Parameters
    ----------
    path : the .xml of `palpmap export RUN --to mujoco`; its .npz lies beside it

    Raises
    ------
    InputError
        A file is missing, or the two do not belong together.

    Examples
    --------
    >>> import palpmap as pm
    >>> from palpmap.export import export_run
    >>> run = pm.read_run("tests/data/twelve_presses")
    >>> path, _ = export_run(run, "mujoco", getfixture("tmp_path") / "body.xml")
    >>> pm.load_mujoco(path).nflex
    1
    """
    from mujoco import MjModel  # pyright: ignore[reportAttributeAccessIssue]

    path = Path(path)
    for file in (path, path.with_suffix(".npz")):
        if not file.is_file():
            raise InputError(
                f"{file}: no such file, expected one that `palpmap export RUN --to mujoco` wrote"
            )
    model = MjModel.from_xml_path(str(path))
    with np.load(path.with_suffix(".npz")) as stored:
        elements, modulus = stored["elements"], stored["modulus_pa"]
    compiled = np.sort(np.asarray(model.flex_elem).reshape(-1, 4), axis=1)
    if not np.array_equal(compiled, np.sort(elements, axis=1)):
        raise InputError(f"{path}: its elements are not those of the .npz beside it; export again")
    stiffness = np.asarray(model.flex_stiffness).reshape(len(modulus), -1)
    model.flex_stiffness[:] = (stiffness * (modulus / modulus[0])[:, None]).reshape(
        model.flex_stiffness.shape
    )
    return model


def _mesh(body: ExportedBody) -> Mesh:
    """Mesh with four nodes a cell: a block anew, by the tip's size; another body's own."""
    size = body.run.experiment.study.body.size_m
    if size is None:
        cells = body.mesh.cells[:, :4]
        used, renumbered = np.unique(cells, return_inverse=True)
        place = np.full(len(body.mesh.nodes), -1)
        place[used] = np.arange(len(used))
        surfaces = {name: place[faces[:, :3]] for name, faces in body.mesh.surfaces.items()}
        return Mesh(body.mesh.nodes[used], renumbered.reshape(cells.shape), surfaces)
    cell = CELL * float(np.min(body.model.contacts.radius_m))
    across = np.clip(np.ceil(np.array(size) / cell).astype(int), 4, MOST_CELLS)
    layers = max(4, min(12, round(0.6 * size[2] / cell) + 3))
    return block_mesh(size, (int(across[0]), int(across[1]), layers), GRADING, 1, "alternating")


def _mjcf(
    body: ExportedBody,
    mesh: Mesh,
    vertices: np.ndarray,
    held: np.ndarray,
    poisson_ratio: float,
    modulus_pa: float,
) -> str:
    points = " ".join(f"{value:.9g}" for value in vertices.ravel())
    return f"""<mujoco model={quoteattr(body.run.experiment.study.study.name)}>
  <!-- All elements have the modulus of the first here. palpmap.load_mujoco, or
       flex_stiffness *= modulus_pa / modulus_pa[0], element by element, gives each its own. -->
  <option gravity="0 0 0" integrator="discrete" timestep="{TIME_STEP_S}"/>
  <size memory="2G"/>
  <worldbody>
    <flexcomp name="body" type="direct" dim="3" mass="{DENSITY * mesh.volume:.6g}" radius="0.0005"
      point="{points}"
      element="{" ".join(map(str, mesh.cells.ravel().tolist()))}">
      <pin id="{" ".join(map(str, held.tolist()))}"/>
      <contact selfcollide="none"/>
      <elasticity young="{modulus_pa:.9g}" poisson="{poisson_ratio:.9g}" damping="{DAMPING}"/>
    </flexcomp>
  </worldbody>
</mujoco>
"""
