"""What the finite elements are held against: closed forms, published tables, other solvers.

Writes the table between the marks `validate:table` of docs/benchmarks.md.
`python benchmarks/validate.py`, part of `make validate`; about seven minutes. The
references are those of the tests, from which this takes them.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

import accuracy
from run import PAGE, machine
from scipy.integrate import quad

from fem import Contacts, PalpationModel, RefinedModel, Skin, block_mesh
from fem.contact.contacts import contact_weights
from fem.finite_strain.hyperelastic import NeoHookean
from fem.finite_strain.model import FiniteStrainModel
from fem.linear.assembly import Stiffness, lame
from fem.mesh.mesh import Mesh, promote_to_tet10
from fem.palpation.rigid_punch import shape_gain
from tests.fem.contact import test_half_space as half_space
from tests.fem.finite_strain import test_calculix as calculix
from tests.fem.finite_strain import test_hyperelastic as hyperelastic
from tests.fem.linear import test_assembly as assembly
from tests.fem.linear import test_manufactured as manufactured
from tests.fem.palpation.test_skin import lab, modulus
from tests.fem.reference import graded_reference as graded
from tests.fem.reference import test_cook as cook
from tests.fem.reference import test_graded_tip_mesh as tip_surface
from tests.fem.reference import test_prony as prony
from tests.fem.reference import test_unilateral as unilateral
from tests.fem.reference.hayes import punch_factor
from tests.fem.reference.material_point import material_point
from tests.fem.reference.prony import respond
from tests.fem.reference.test_hayes import HAYES, RATIOS
from tests.fem.reference.unilateral import press_by, sphere_gap

Row = tuple[str, str, str]  # what, against what, how far apart
FIRST, LAST = "<!-- validate:table -->", "<!-- /validate:table -->"
DOWN = np.array([0.0, 0.0, -1.0])


def percent(value: float) -> str:
    return f"{100 * abs(value):.2g} %"


def patch() -> Iterator[Row]:
    far = 0.0
    for order in (1, 2):
        mesh = assembly.distorted_block(order, (3, 3, 3))
        for nu in (0.3, 0.4999):
            stiffness = Stiffness(mesh, nu, "nowhere")
            matrix = assembly.matrix_of(stiffness, np.ones(len(stiffness.points_m)))
            slope = np.random.default_rng(8).normal(size=(3, 3))
            exact = (mesh.nodes @ slope.T).ravel()
            held = np.repeat(np.isin(np.arange(len(mesh.nodes)), mesh.boundary), 3)
            inner = matrix[~held][:, ~held].toarray()
            solved = np.linalg.solve(inner, -matrix[~held][:, held] @ exact[held])
            far = max(far, abs(solved - exact[~held]).max() / abs(exact).max())
    what = "Patch test, distorted cells, Poisson's ratio 0.3 and 0.4999"
    yield what, "linear field", f"{far:.0e}"


def rates() -> Iterator[Row]:
    for order, coarse, fine in ((1, 6, 12), (2, 3, 6)):
        errors = [manufactured.errors(order, n) for n in (coarse, fine)]
        u, slope = np.log(np.divide(*errors)) / np.log(fine / coarse)
        yield (
            f"Rates of displacement and strain, {(4, 10)[order - 1]}-node cells",
            f"theory: {order + 1} and {order}",
            f"{u:.2f} and {slope:.2f}",
        )


def layer(radius: float, nu: float) -> PalpationModel:
    """Return a bonded layer of thickness 1, wide as if without end, finer towards the middle."""
    plain = block_mesh((2, 2, 1), (12, 12, 4), order=1)
    flat = (radius + 6) * np.sinh(3 * (plain.nodes[:, :2] - 1)) / np.sinh(3)
    nodes = np.column_stack([flat, plain.nodes[:, 2] - 1])
    mesh = promote_to_tet10(Mesh(nodes, plain.cells, plain.surfaces))
    contacts = Contacts(np.zeros((1, 3)), DOWN, np.array([radius]))
    return PalpationModel(mesh, nu, contacts)


def hayes() -> Iterator[Row]:
    kinds: dict[bool, list[float]] = {False: [], True: []}
    for wide, factors in HAYES.items():
        if wide > 1:
            continue
        for nu, factor in zip(RATIOS, factors, strict=True):
            limit = nu == 0.5
            nu = min(nu, 0.4999)
            exact = punch_factor(wide, nu) if limit else factor
            model = layer(wide, nu)
            response = model.evaluate(1.0)
            gain = shape_gain(response, np.ones(1))  # the layer's own pressure
            compliance = (response.compliance - gain)[0]
            kinds[limit].append((1 - nu**2) / (2 * wide * compliance) / exact - 1)
    for limit, errors in kinds.items():
        yield (
            "Flat tip on a bonded layer, a/h 0.2 to 1, "
            + ("Poisson's ratio 0.4999" if limit else "Poisson's ratio 0.3 to 0.45"),
            "Hayes' integral equation" if limit else "Hayes' table",
            f"{percent(float(np.abs(errors).max()))} at most",
        )


def hertz() -> Iterator[Row]:
    radius, travel = 0.1, 1e-4
    centres, matrix = unilateral.half_space(1.3 * np.sqrt(radius * travel), 32)
    force = press_by(matrix, sphere_gap(centres, radius), travel).force_n
    exact = 4 / 3 * unilateral.PLANE * np.sqrt(radius) * travel**1.5
    yield "Sphere on the half-space, unilateral contact", "Hertz", percent(force / exact - 1)


def upright_tip() -> Iterator[Row]:
    found = [tip_surface.near_an_edge(y) for y in (0.048, 0.012)]
    assumed, own = ([percent(pair[i] - 1) for pair in found] for i in (0, 1))
    yield (
        "Rigid tip of 10 mm held upright, rim 2 mm from an edge and from a corner",
        "unilateral contact",
        f"{own[0]} and {own[1]} ({assumed[0]} and {assumed[1]} under the assumed pressure)",
    )


def boussinesq() -> Iterator[Row]:
    errors = []
    for profile in (half_space.FLAT, half_space.HERTZ):
        for place in half_space.PLACES:
            exact = half_space.boussinesq(place, profile, half_space.NU)
            found = half_space.displacement(place, profile)
            errors.append(abs(found - exact).max() / abs(exact).max())
    yield "Near field of a tip", "integral of Boussinesq's point force", f"{max(errors):.0e}"


def cooks_membrane() -> Iterator[Row]:
    exact, middle = cook.mixed_deflection(24, 1 / 3, plane_strain=False)
    published = f"published {cook.PUBLISHED}"
    yield "Cook's membrane, plane mixed elements", published, percent(middle / cook.PUBLISHED - 1)
    thin = cook.slab_deflection(16, 1 / 3, plane_strain=False) / exact - 1
    yield (
        "Cook's membrane, thin, Poisson's ratio 1/3, 16 x 16",
        "plane mixed elements (Taylor-Hood)",
        percent(thin),
    )
    exact, _ = cook.mixed_deflection(24, cook.NU)
    errors = (percent(cook.slab_deflection(n, cook.NU) / exact - 1) for n in (4, 8, 16))
    yield (
        "Cook's membrane, plane strain, 0.4999, 4, 8 and 16 a side",
        "plane mixed elements (Taylor-Hood)",
        ", ".join(errors),
    )


def hyperelastic_laws() -> Iterator[Row]:
    forms, turned, derived = [0.0], [0.0], [0.0]
    nu, small = 0.5 - 1e-9, 1e-5
    f, turn = hyperelastic.random_deformations(), hyperelastic.random_rotation(7)
    for law, slope in hyperelastic.LAWS:
        for s in hyperelastic.STRETCHES:
            mu = 1 / (2 * (1 + nu))
            exact = mu * slope(s**2 + 2 / s) * (s - s**-2)
            forms.append(hyperelastic.free_sides(law, nu, [s])[1][0, 0] / exact - 1)
            exact = mu * slope(2 * s**2 + s**-4) * (s - s**-5)
            forms.append(hyperelastic.free_sides(law, nu, [s, s])[1][0, 0] / exact - 1)
        point, other = (material_point(law, hyperelastic.NU, g) for g in (f, turn @ f))
        scale = abs(point.stress).max()
        turned.append(abs(other.stress - turn @ point.stress).max() / scale)
        for i, j in np.ndindex(3, 3):
            move = np.zeros((3, 3))
            move[i, j] = small
            up, down = (material_point(law, hyperelastic.NU, f + m) for m in (move, -move))
            by_energy = (up.energy - down.energy) / (2 * small)
            by_stress = (up.stress - down.stress) / (2 * small)
            derived.append(abs(by_energy - point.stress[:, i, j]).max() / scale)
            far = abs(by_stress - point.tangent[..., i, j]).max()
            derived.append(far / abs(point.tangent).max())
    names = "Neo-Hookean, Yeoh, Fung"
    yield f"{names}: uniaxial and biaxial tension, 0.6 to 1.7", "closed forms", worst(forms)
    yield f"{names}: objectivity", "turned stress", worst(turned)
    yield f"{names}: stress and tangent", "differences of the energy, of the stress", worst(derived)


def worst(errors: list[float]) -> str:
    return f"{np.abs(errors).max():.0e}"


def creep() -> Iterator[Row]:
    times = np.array([0.0, 1e-3, 0.3, 0.31, 4.0, 70.0])
    terms = prony.CREEP
    exact = [quad(terms, 0, t, limit=400, epsabs=0, epsrel=1e-12)[0] for t in times[1:]]
    found = respond(terms, times, times, np.zeros(len(times), int))[1:]
    yield (
        "Prony series, three terms: response to a ramp",
        "integral of the creep function",
        worst(found / exact - 1),
    )
    back = terms.relaxation().creep()
    order = np.argsort(back.times_s)
    change = (back.amplitudes[order] / terms.amplitudes - 1).tolist()
    yield "Prony series: creep to relaxation and back", "itself", worst(change)


def against_calculix() -> Iterator[Row]:
    what = "Finite strain, depth 20 % of the height, Poisson's ratio 0.49"
    if calculix.CCX is None:
        yield what, "CalculiX", "not measured: `ccx` is not installed"
        return
    nu, force = 0.49, 3.0
    mesh = block_mesh(calculix.SIZE, (4, 4, 2))
    contacts = Contacts(np.array([(0.03, 0.03, 0.03)]), DOWN, np.array([0.012]))
    model = FiniteStrainModel(mesh, nu, contacts, NeoHookean())
    lam, mu = (calculix.MODULUS * value for value in lame(nu))
    weights = contact_weights(mesh, contacts)[0]
    deck = calculix.deck(mesh, weights, force, mu / 2, 2 / (lam + 2 * mu / 3))
    with tempfile.TemporaryDirectory() as folder:
        field = calculix.displacement_by_calculix(Path(folder), deck, len(mesh.nodes))
    reading = float((weights * field).sum())
    ours = model.evaluate(calculix.MODULUS, [force]).readings_m[0, 0]
    yield what, "CalculiX (its own compressible law)", percent(ours / reading - 1)


def laboratory() -> Iterator[Row]:
    points = accuracy.case("case_a")[0]
    pair = (PalpationModel(block_mesh(accuracy.SIZE_M, cells), 0.49, points)
            for cells in (accuracy.COARSE, accuracy.FINE))  # fmt: skip
    model = RefinedModel(*pair)
    for name in ("case_a", "case_k", "case_e", "case_f"):
        body, _, exact = lab(name)
        layer = body.get("skin_layer")
        skin = None if layer is None else Skin(layer["thickness_m"], layer["modulus_factor"])
        found = model.evaluate(modulus(body, model.points_m), skin=skin).compliance
        errors = found / exact - 1
        yield (
            f"81 presses of `{name}`, true parameters" + (", with its skin" if skin else ""),
            "hexahedra fitted to the tip's rim",
            f"{percent(accuracy.rms(errors))} rms, {percent(float(abs(errors).max()))} at most",
        )


def hard_presses() -> Iterator[Row]:
    chosen, off, held = list(graded.presses()), [], 0
    for nu in graded.RATIOS:
        found, error = graded.by_model(chosen, nu)
        far = found / [graded.reference(press, nu) for press in chosen] - 1
        held += int(np.sum(np.abs(far) <= 2 * np.abs(error)))
        off += far.tolist()
    what = (
        f"{len(off)} hard presses: tips of 2 to 10 mm, Poisson's ratio 0.3 to 0.4999, rim 2 mm "
        "from an edge, inclusion of 8 mm, six times as stiff, 12 mm deep"
    )
    at_most = f"{percent(accuracy.rms(np.array(off)))} rms, {percent(max(map(abs, off)))} at most"
    yield what, "meshes graded around each tip", at_most
    yield "Their error", "twice the model's own estimate", f"within it in {held} of {len(off)}"


CHECKS: tuple[Callable[[], Iterator[Row]], ...] = (
    patch, rates, hayes, hertz, upright_tip, boussinesq, cooks_membrane, hyperelastic_laws, creep,
    against_calculix, laboratory, hard_presses,
)  # fmt: skip


def main() -> None:
    lines = ["| what | against | apart |", "|---|---|---:|"]
    for check in CHECKS:
        for row in check():
            lines.append(f"| {' | '.join(row)} |")
            print(lines[-1], flush=True)
    lines += ["", f"Computed on {machine()}."]
    text = PAGE.read_text(encoding="utf-8")  # late, so that an edit made during the run is kept
    before, rest = text.split(FIRST)
    after = rest.split(LAST)[1]
    PAGE.write_text("\n".join([before + FIRST, *lines, LAST + after]), encoding="utf-8")


if __name__ == "__main__":
    main()
