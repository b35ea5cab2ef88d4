"""Sampled intervals beside those of the covariance and of the valley, and the trust in them."""

import math

from palpmap import units
from palpmap.result.finding import Finding
from palpmap.result.tables import Cell, Table, number
from palpmap.study.frame import frame_shift_m


def posterior_table(f: Finding) -> Table:
    """Return the 95 % intervals of the free parameters by three methods; empty without samples."""
    posterior, rows = f.fit.posterior, []
    for name, p in ({} if posterior is None else posterior.parameters).items():
        entry, shift = f.parameters[name], frame_shift_m(name, f.origin_m)
        factor, unit = units.scale(entry.unit)
        ends = (
            (p.straight_lower95 + shift, p.straight_upper95 + shift),
            (entry.lower95, entry.upper95),
            (p.lower95 + shift, p.upper95 + shift),
        )
        width = factor * (p.upper95 - p.lower95)
        digits = max(1 - math.floor(math.log10(max(width, 1e-12))), 0)
        few = min(p.effective, p.effective_tail)
        rows.append(
            (
                f"{units.plain_name(name)}, {unit}".rstrip(", "),
                *("–".join(f"{factor * end:.{digits}f}" for end in pair) for pair in ends),
                Cell(f"{few:.0f}", "" if p.settled else "bad"),
            )
        )
    head = ("Parameter", *map(number, ("Covariance", "Valley", "Sampled", "Effective")))
    return Table.of(head, rows, "95 % intervals by three methods" if rows else "")


def posterior_words(f: Finding) -> tuple[str, ...]:
    """Return a sentence on the samples; nothing without any."""
    posterior = f.fit.posterior
    if posterior is None:
        return ()
    worth = (
        f"{posterior.samples} samples in {posterior.chains} chains, worth at least "
        f"{posterior.effective:.0f} independent ones (R-hat at most {posterior.r_hat:.3f})"
    )
    if posterior.settled:
        return (f"{worth}: the sampled intervals can be used.",)
    return (
        f"The samples have not settled: {worth}. Do not use the sampled intervals; draw more "
        "samples, or hold a parameter that the scan hardly shows.",
    )
