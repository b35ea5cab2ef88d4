r"""Supports of a body: bonded, on an elastic foundation, sliding, with further surfaces bonded.

On the support's surface the displacement is a compliance times the traction, normal and tangential,

    u_n = s_n t_n,    u_t = s_t t_t        (s in m/Pa),

s = 0 holds it, s_t = inf lets it slide. The springs' energy uses the surface's consistent mass
matrix M and a unit normal n_i a node, T_i = I - n_i n_i' (a normal a face would lock a curved
surface that slides):

    1/2 sum_ij M_ij [u_i.n_i n_j.u_j / s_n + (T_i u_i).(T_j u_j) / s_t].

With the nodal reactions R of a press by unit force, for s = 0 too,

    dC/ds_n = R_n' M^-1 R_n  ~  int t_n^2 dA,    dC/ds_t = sum_a R_ta' M^-1 R_ta  ~  int |t_t|^2 dA.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from fem.errors import MeshError
from fem.linear.assembly import Stiffness, shape_functions
from fem.mesh.mesh import Mesh

# Compliances below the first, as a multiple of (size of a face)/E, stand for 0; tangential ones
# above the second, as a multiple of (size of the surface)/E, for infinity; the rest is added to
# first order. Stiffer springs would drown those along a slanted surface in rounding, softer ones
# would not keep a body in place that slides freely.
_HELD = 1e-6
_FREE = 1e4


@dataclass(frozen=True)
class Support:
    """Support of a body.

    Attributes
    ----------
    surface : name of the mesh's surface that rests on the support
    normal : compliance across the surface, m/Pa, >= 0 and finite; 0 holds it
    tangential : compliance along the surface, m/Pa, >= 0; 0 holds it, `math.inf` lets it slide
    held : names of further surfaces, that are bonded (as a block's "sides" or "x0", see
        `fem.block_mesh`)
    """

    surface: str = "base"
    normal: float = 0.0
    tangential: float = 0.0
    held: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not (0 <= self.normal < np.inf and self.tangential >= 0):
            raise MeshError(
                "a support's compliance must be >= 0 m/Pa and finite across the surface, "
                f"got normal {self.normal} and tangential {self.tangential}"
            )
        if isinstance(self.held, str):
            raise MeshError(f"held is a tuple of surface names, got '{self.held}'")

    @property
    def bonded(self) -> bool:
        """True if the surface does not move at all."""
        return self.normal == 0 and self.tangential == 0


class Foundation:
    """The springs under one surface, on the pattern of a stiffness matrix that leaves it free.

    Attributes
    ----------
    nodes : (b,) the surface's nodes that are not held by another surface
    normals : (b, 3) unit normals out of the body
    """

    def __init__(self, stiffness: Stiffness, surface: str) -> None:
        mesh = stiffness.mesh
        faces = mesh.surface(surface)
        if not len(faces):
            raise MeshError(f"surface '{surface}' has no faces to rest on")
        nodes = np.unique(faces)
        nodes = nodes[stiffness.free_number[nodes] >= 0]
        mass, normals, area = _mass_and_normals(mesh, faces)
        self.nodes = nodes
        self.normals = normals[nodes]
        self._mass = mass[nodes][:, nodes].tocsc()
        self._face_size = float(np.sqrt(area / len(faces)))
        self._size = float(np.sqrt(area))
        self._free = stiffness.free_number[nodes]
        self._place_springs(stiffness)

    def _place_springs(self, stiffness: Stiffness) -> None:
        """Find where each spring stands among the values of the upper triangle."""
        mass = self._mass.tocoo()
        normal = self.normals
        tangent = np.eye(3) - normal[:, :, None] * normal[:, None, :]
        i, j = mass.coords
        along_n = mass.data[:, None, None] * normal[i, :, None] * normal[j, None, :]
        along_t = mass.data[:, None, None] * (tangent[i] @ tangent[j])
        axis = np.arange(3)
        row = np.broadcast_to(3 * self._free[i, None, None] + axis[:, None], along_n.shape)
        column = np.broadcast_to(3 * self._free[j, None, None] + axis, along_n.shape)
        upper = row <= column
        self._place = stiffness.places(row[upper], column[upper])
        self._normal_values, self._tangential_values = along_n[upper], along_t[upper]

    def effective(
        self, normal: float, tangential: float, modulus: np.ndarray
    ) -> tuple[float, float]:
        """Compliances (s_n, s_t) of the springs that stand for the asked ones, in (0, inf)."""
        low = _HELD * self._face_size / modulus.max()
        normal = max(normal, low)
        high = _FREE * (self._size / modulus.min() + normal)
        return normal, min(max(tangential, low), high)

    def add(self, values: np.ndarray, compliance: tuple[float, float]) -> None:
        """Add the springs of compliances (s_n, s_t), in (0, inf), to the matrix's values."""
        values[self._place] += self._normal_values / compliance[0]
        values[self._place] += self._tangential_values / compliance[1]

    def tractions(self, reactions: np.ndarray) -> np.ndarray:
        """Tractions (j, b, 3) at the nodes with these nodal forces (j, b, 3)."""
        forces = reactions.transpose(1, 0, 2)
        solved = splu(self._mass).solve(np.ascontiguousarray(forces.reshape(len(forces), -1)))
        return solved.reshape(forces.shape).transpose(1, 0, 2)

    def scaled(self, vectors: np.ndarray, normal: float, tangential: float) -> np.ndarray:
        """Nodal vectors (j, b, 3) with their normal and tangential parts times a factor each."""
        across = np.einsum("jba,ba->jb", vectors, self.normals)[:, :, None] * self.normals
        return tangential * vectors + (normal - tangential) * across

    def products(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Integrals of the products of normal and of tangential parts, (j, 2), of (j, b, 3)."""
        normal = [
            np.einsum("jba,ba->jb", each, self.normals)[..., None] for each in (first, second)
        ]
        along = [self.scaled(each, 0.0, 1.0) for each in (first, second)]
        return np.column_stack([self._integral(*normal), self._integral(*along)])

    def _integral(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Integral (j,) of the product of nodal values (j, b, c)."""
        by_node = np.ascontiguousarray(second.transpose(1, 0, 2))
        weighed = (self._mass @ by_node.reshape(len(by_node), -1)).reshape(by_node.shape)
        return np.einsum("jbc,bjc->j", first, weighed)


def first_order_rest(
    asked: tuple[float, float], springs: tuple[float, float], sensitivity: np.ndarray
) -> np.ndarray:
    """Change of the compliances (j,) from the springs in the matrix to the asked ones.

    In s where the asked one is smaller, in 1/s where it is larger; sensitivity (j, 2) is dC/ds.
    """
    change = np.zeros(len(sensitivity))
    for k, (s, spring) in enumerate(zip(asked, springs, strict=True)):
        step = s - spring if s <= spring else spring * (1 - spring / s)
        change += step * sensitivity[:, k]
    return change


def _mass_and_normals(mesh: Mesh, faces: np.ndarray) -> tuple[sp.csr_array, np.ndarray, float]:
    """Mass matrix (n, n), normals (n, 3) and area of a surface; normals are means over faces."""
    corners = mesh.nodes[faces[:, :3]]
    vector = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    area = np.linalg.norm(vector, axis=1)
    points, weights = triangle_rule()
    shape = shape_functions(points, mesh.order)
    local = np.einsum("p,pi,pj->ij", weights, shape, shape)
    values = area[:, None, None] * local
    rows = np.broadcast_to(faces[:, :, None], values.shape)
    columns = np.broadcast_to(faces[:, None, :], values.shape)
    n = len(mesh.nodes)
    mass = sp.coo_array((values.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n)).tocsr()
    normals = np.zeros((n, 3))
    np.add.at(normals, faces, vector[:, None])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return mass, normals / np.where(length > 0, length, 1), float(area.sum())


def triangle_rule() -> tuple[np.ndarray, np.ndarray]:
    """Barycentric points (p, 3) and weights, exact to degree 4 (Gauss on the collapsed square)."""
    x, w = np.polynomial.legendre.leggauss(4)
    x, w = (x + 1) / 2, w / 2
    a, b = np.meshgrid(x, x, indexing="ij")
    points = np.stack([a, (1 - a) * b, (1 - a) * (1 - b)], axis=-1).reshape(-1, 3)
    return points, (2 * np.outer(w * (1 - x), w)).ravel()
