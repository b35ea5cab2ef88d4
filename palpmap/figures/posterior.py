"""Corner plot: draws from the posterior, each pair of parameters against each other."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from palpmap import units
from palpmap.figures.style import BLACK, BLUE, GREEN, GREY, ORANGE, legend_below, new_figure
from palpmap.result.finding import Finding
from palpmap.study.frame import frame_shift_m

_MOST = 12  # parameters
_POINTS = 2000
_ELLIPSE = 2.4477  # radius that holds 95 % of a normal distribution of two parameters
_BINS = 40
_REACH = 0.0005  # share of the draws beyond a panel, on each side


def draw_corner(f: Finding) -> Figure | None:
    """Draw the posterior: draws of each pair, with the covariance's ellipse; None without draws."""
    posterior, solution = f.fit.posterior, f.fit.solution
    if posterior is None or posterior.draws is None or solution is None:
        return None
    names = tuple(posterior.parameters)[:_MOST]
    size = 1.9 * len(names)
    figure = new_figure(max(size, 6.0), max(size, 5.0))
    grid = figure.subplots(len(names), len(names), squeeze=False)
    shown = [_Shown(f, name) for name in names]
    draws = posterior.draws.reshape(-1, posterior.draws.shape[-1])
    draws = np.column_stack([one.to_shown(draws[:, i]) for i, one in enumerate(shown)])
    thin = draws[:: max(len(draws) // _POINTS, 1)]
    reach = np.quantile(draws, (_REACH, 1 - _REACH), axis=0).T
    known = solution.model.unknowns.unknowns
    angle = np.linspace(0, 2 * np.pi, 181)
    circle = _ELLIPSE * np.column_stack([np.cos(angle), np.sin(angle)])
    for row, one in enumerate(shown):
        for column, other in enumerate(shown):
            axes = grid[row, column]
            if column > row:
                axes.set_axis_off()
                continue
            if column == row:
                _draw_marginal(axes, f, one, draws[:, row])
            else:
                pair = [column, row]
                root = np.linalg.cholesky(solution.covariance[np.ix_(pair, pair)])
                u = solution.u[pair] + circle @ root.T
                curve = [
                    shown[i].to_shown(np.array([known[i].to_value(v) for v in u[:, side]]))
                    for side, i in enumerate(pair)
                ]
                axes.plot(thin[:, column], thin[:, row], ".", ms=1.5, color=BLUE, alpha=0.35)
                axes.plot(*curve, color=ORANGE, lw=1.2, ls="--")
                axes.plot(other.estimate, one.estimate, "+", color=BLACK)
                if one.true is not None and other.true is not None:
                    axes.plot(other.true, one.true, "x", color=GREEN)
                axes.set_ylim(*reach[row])
            axes.set_xlim(*reach[column])
            _label(axes, other.label, one.label, row == len(names) - 1, column == 0 < row)
    legend_below(figure, [grid[0, 0]])
    return figure


class _Shown:
    """A parameter in the units and in the frame that a reader sees."""

    def __init__(self, f: Finding, name: str) -> None:
        entry = f.parameters[name]
        self._factor, unit = units.scale(entry.unit)
        self._shift = frame_shift_m(name, f.origin_m)
        self.name = name
        self.label = "\n".join(units.plain_name(name).rsplit(" ", 1)) + (
            f"\n{unit}" if unit else ""
        )
        self.estimate = self._factor * entry.value
        self.valley = self._factor * entry.lower95, self._factor * entry.upper95
        true = f.true.get(name)
        self.true = None if true is None else self._factor * true

    def to_shown(self, values: np.ndarray) -> np.ndarray:
        """Return values of the body's frame as they are shown."""
        return self._factor * (values + self._shift)


def _draw_marginal(axes: Axes, f: Finding, one: _Shown, draws: np.ndarray) -> None:
    """Draw a parameter's histogram with its three intervals above."""
    assert f.fit.posterior is not None
    p = f.fit.posterior.parameters[one.name]
    counts, _, _ = axes.hist(draws, _BINS, color=BLUE, alpha=0.35)
    top = float(np.max(counts))
    bars = (
        (one.to_shown(np.array([p.straight_lower95, p.straight_upper95])), ORANGE, "--",
         "95 % by the covariance"),
        (np.array(one.valley), BLACK, "-", "95 % along the valley"),
        (one.to_shown(np.array([p.lower95, p.upper95])), BLUE, "-", "95 % sampled"),
    )  # fmt: skip
    for level, (ends, color, style, label) in enumerate(bars):
        axes.plot(ends, 2 * [top * (1.1 + 0.12 * level)], style, color=color, lw=2, label=label)
    if one.true is not None:
        axes.axvline(one.true, color=GREEN, lw=1, label="true value")
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)


def _label(axes: Axes, below: str, beside: str, last: bool, first: bool) -> None:
    """Put labels and ticks at the outer panels alone."""
    axes.tick_params(labelsize=7, color=GREY)
    for axis in (axes.xaxis, axes.yaxis):
        if axis is axes.xaxis or first:
            axis.set_major_locator(MaxNLocator(3))
    if last:
        axes.set_xlabel(below, fontsize=8)
        axes.tick_params(axis="x", rotation=45)
    else:
        axes.set_xticklabels([])
    if first:
        axes.set_ylabel(beside, fontsize=8)
    else:
        axes.set_yticklabels([])
