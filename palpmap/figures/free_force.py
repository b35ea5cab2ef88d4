"""Free force of a rig before and after each contact."""

from matplotlib.figure import Figure

from palpmap.importing.streams.rig_check import RigCheck


def draw_free_force(found: RigCheck) -> Figure:
    """Draw the free force along the direction of pressing over the time of the recording."""
    figure = Figure(figsize=(7, 3), layout="constrained")
    axes = figure.subplots()
    axes.plot(found.time_s, 1e3 * found.before_n, "o", label="before the contact")
    axes.plot(found.time_s, 1e3 * found.after_n, "x", label="after it")
    axes.set_xlabel("time, s")
    axes.set_ylabel("free force, mN")
    axes.ticklabel_format(useOffset=False)
    figure.legend(loc="outside upper right", ncols=2)
    return figure
