"""The body with its moduli for FEBio: a .feb file of version 4.0.

The material's modulus is a map over the elements (`<E type="map">`, filled by `ElementData`).
Source: FEBio User Manual 4, sections "Mesh Section" and "MeshData Section".
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from palpmap.export.body import ExportedBody

DENSITY = 1000.0  # kg/m^3; a static analysis does not use it
NODES = {4: "tet4", 10: "tet10"}


def write_febio(body: ExportedBody, path: Path) -> None:
    """Write mesh, neo-Hookean material with a modulus an element, and the held base."""
    mesh, name = body.mesh, body.run.experiment.study.study.name.replace("--", "-")
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<febio_spec version="4.0">',
        f"<!-- {name}: map found by palpmap; m, N, Pa. Add a load or a contact. -->",
        '<Module type="solid"/>',
        "<Control><analysis>STATIC</analysis><time_steps>1</time_steps>"
        "<step_size>1</step_size></Control>",
        '<Material><material id="1" name="tissue" type="neo-Hookean">'
        f'<density>{DENSITY:g}</density><E type="map">young</E><v>{body.poisson_ratio:g}</v>'
        "</material></Material>",
        "<Mesh>",
        '<Nodes name="body_nodes">',
        *_rows("node", mesh.nodes + body.origin_m),
        "</Nodes>",
        f'<Elements type="{NODES[mesh.cells.shape[1]]}" name="body">',
        *_rows("elem", mesh.cells + 1),
        "</Elements>",
        f'<NodeSet name="held">{",".join(map(str, body.held + 1))}</NodeSet>',
        "</Mesh>",
        '<MeshDomains><SolidDomain name="body" mat="tissue"/></MeshDomains>',
        '<MeshData><ElementData name="young" elem_set="body" data_type="scalar">',
        *(f'<e lid="{k}">{value:.9g}</e>' for k, value in enumerate(body.cell_modulus, start=1)),
        "</ElementData></MeshData>",
        '<Boundary><bc name="held" node_set="held" type="zero displacement">'
        "<x_dof>1</x_dof><y_dof>1</y_dof><z_dof>1</z_dof></bc></Boundary>",
        '<Output><plotfile type="febio"><var type="displacement"/><var type="stress"/></plotfile>'
        "</Output>",
        "</febio_spec>",
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _rows(tag: str, table: np.ndarray) -> Iterable[str]:
    for number, row in enumerate(table.tolist(), start=1):
        yield f'<{tag} id="{number}">{",".join(f"{value:.9g}" for value in row)}</{tag}>'
