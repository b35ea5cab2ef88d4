"""Tetrahedral finite elements for palpation.

Symbols used throughout (SI units): `n` nodes, `e` cells, `q` quadrature points of a cell, `j`
presses, `k` parameters, `p` points at which Young's modulus is sampled. `u` displacement (m),
`E` Young's modulus (Pa), `nu` Poisson's ratio, `C` compliance of a press (m/N). A force is positive
when it presses into the body; a press direction is the unit vector into the body; the travel of
a tip is positive inwards.
"""

from fem.contact.contacts import Contacts
from fem.errors import FoldedSurfaceError, MeshError, SolverError
from fem.linear.support import Support
from fem.mesh.block import block_mesh, paper_mesh
from fem.mesh.checks import check_mesh
from fem.mesh.mesh import Mesh, promote_to_tet10
from fem.mesh.surface import Surface, check_surface, read_surface
from fem.mesh.tetrahedralize import check_underside, tetrahedralize_surface
from fem.palpation.fibres import Fibres, fibre_weights
from fem.palpation.model import PalpationModel, Response
from fem.palpation.richardson import RefinedModel
from fem.palpation.skin import Skin
from fem.solve.direct import default_solver

__all__ = [
    "Contacts",
    "Fibres",
    "FoldedSurfaceError",
    "Mesh",
    "MeshError",
    "PalpationModel",
    "RefinedModel",
    "Response",
    "Skin",
    "SolverError",
    "Support",
    "Surface",
    "block_mesh",
    "check_mesh",
    "check_surface",
    "check_underside",
    "default_solver",
    "fibre_weights",
    "paper_mesh",
    "promote_to_tet10",
    "read_surface",
    "tetrahedralize_surface",
]
