"""Tuning numbers of the body's mechanics."""

from dataclasses import dataclass


@dataclass(frozen=True)
class BodySettings:
    """Settings of `identify.body.mechanics`, its shifted block and its discretization error.

    Attributes
    ----------
    poisson_ratios : ratios with a finite element model; C is interpolated between the
        body's own and those on both sides
    poisson_step : of the difference quotient by Poisson's ratio: a step of 0.01 near 0.49 made its
        derivative 1.4 to 1.5 times as large
    ratio_error : relative error of a compliance up to which the ratio of another model's to the
        coarse one's is taken linear in the map
    reduced_error : relative error of a compliance up to which a search takes a reduced basis
    fine_bend : error of the ratio of the finer mesh's compliances over its estimate, at most
        (measured: 5)
    local_depth : depth of the local modulus under a tip, in contact radii
    believed_ratio : compliance of the finer model over the coarse one's; beyond, neither mesh
        resolves the map, and nothing is extrapolated
    mesh_rate : order of convergence of meshes that are not extrapolated, for presses away from
        edges and steep inclusions
    curved_contact_error : relative error of the compliance of a contact on a curved surface, the
        same for all presses, of a flat tip and of a ball: see `benchmarks/curved.py`
    narrower : contacts whose compliance tells how that of a ball's grows, of its own radius; wider
        ones might not lie on the body
    error_at_zero : mesh error at Poisson's ratio zero, relative to the growth -ln(1 - 2 nu), see
        `mesh_error_growth`
    shifts : shifts of a block with a model, in side lengths; C is interpolated between them
    shift_room : share of the gap between tips and edges that a shift may close
    least_shift_m : gap below which a block cannot be shifted
    plain_slack : slack of a search from which on ratios to other models leave out fibres, skin and
        springs
    straight_slack : slack from which on small shifts of a block are interpolated along a chord
    carried_shift_m, carried_change : distance of the body's place, and change of the logarithm of
        a compliance, up to which a search takes the finer model's correction from another place
    carried_slack : slack up to which both grow with it
    near_support : factor between the compliances of two supports within which a search takes the
        finer model's correction of one for the other, in proportion to their effects
    shift_step_m : distance between shifts with a finer model of their own
    """

    poisson_ratios: tuple[float, ...] = (
        0.05, 0.15, 0.25, 0.32, 0.38, 0.42, 0.45, 0.47, 0.48, 0.49, 0.497,
    )  # fmt: skip
    poisson_step: float = 1e-4
    ratio_error: float = 3e-5
    reduced_error: float = 1e-5
    fine_bend: float = 5.0
    local_depth: float = 0.5
    believed_ratio: tuple[float, float] = (0.6, 1.6)
    mesh_rate: float = 2.5
    curved_contact_error: tuple[float, float] = (0.006, 0.003)
    narrower: float = 0.85
    error_at_zero: float = 0.12
    shifts: tuple[float, ...] = (0.01, 0.025, 0.06, 0.12)
    shift_room: float = 0.95
    least_shift_m: float = 1e-4
    shift_step_m: float = 1e-4
    plain_slack: float = 20.0
    straight_slack: float = 50.0
    carried_shift_m: float = 5e-4
    carried_change: float = 0.05
    carried_slack: float = 4.0
    near_support: float = 1.25


BODY = BodySettings()
