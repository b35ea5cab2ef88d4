"""Presses that a map does not meet though it meets the others: least trimmed squares.

A press that slipped pulls the fitted map along, which then misses its neighbours and hides it among
them. Of the relative errors of the presses' compliances, linear in the unknowns of the fit, the
smallest four fifths are therefore minimised alone.

Source: P. J. Rousseeuw, K. Van Driessen, Data Min. Knowl. Discov. 12 (2006) 29-45 (FAST-LTS).
"""

from collections.abc import Sequence

import numpy as np

from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel
from identify.residual.settings import TRIMMED, TrimmedSettings


def presses_apart(
    model: MeasurementModel,
    at: Linearised,
    settings: TrimmedSettings = TRIMMED,
    beside: Sequence[np.ndarray] = (),
) -> np.ndarray:
    """Return the presses (indices) that stand apart from a map that meets the others.

    None where more than the trimmed share stands apart, or where no map meets the others.

    Parameters
    ----------
    at : the model at a map that may be pulled along by these presses
    beside : whitened columns (m, q) of effects, one of which may act on all presses, too
    """
    press = model.readings.press
    own = at.whitened(model.by_log_compliance(at), press)
    return outlying(press, own, at.residual, at.jacobian, settings, beside)


def further(model: MeasurementModel, at: Linearised, presses: np.ndarray) -> np.ndarray:
    """Return by which share presses (indices) travel further than the model at the same force."""
    press, count = model.readings.press, model.readings.presses
    felt, travel = (
        np.bincount(press, model.readings.force_n * column, count)[presses]
        for column in (at.predicted_m, model.displacement_m)
    )
    return travel / felt - 1


def missed(
    model: MeasurementModel,
    at: Linearised,
    presses: np.ndarray,
    settings: TrimmedSettings = TRIMMED,
) -> np.ndarray:
    """Return which of some presses (indices) a model fitted to all others does not meet.

    Parameters
    ----------
    at : at the estimate of the others, of all presses
    """
    press = model.readings.press
    own = at.whitened(model.by_log_compliance(at), press)
    columns = np.column_stack([at.jacobian, at.residual])
    rows = _per_press(press, own, columns)
    matrix, error = rows[:, :-1], rows[:, -1]
    others = np.setdiff1d(np.arange(len(rows)), presses)
    inverse = np.linalg.pinv(matrix[others].T @ matrix[others], hermitian=True)
    variance = 1 + np.einsum("jk,kl,jl->j", matrix[presses], inverse, matrix[presses])
    return np.abs(error[presses]) > settings.sigmas * np.sqrt(variance)


def _per_press(press: np.ndarray, own: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Rows (j, q) of the readings' columns (m, q) along ln C of each press, in its own errors."""
    presses = int(press.max()) + 1
    size = np.sqrt(np.maximum(np.bincount(press, own**2, presses), 1e-30))
    sums = [np.bincount(press, own * column, presses) / size for column in columns.T]
    return np.column_stack([np.zeros((presses, 0)), *sums])


def outlying(
    press: np.ndarray,
    own: np.ndarray,
    residual: np.ndarray,
    jacobian: np.ndarray,
    settings: TrimmedSettings = TRIMMED,
    beside: Sequence[np.ndarray] = (),
) -> np.ndarray:
    """Return the presses (indices) that a linear model does not meet though it meets the others.

    Parameters
    ----------
    press : (m,) index of each reading's press
    own : (m,) derivative of the whitened prediction by ln C of its press
    residual, jacobian : (m,) and (m, k) of the whitened residual and prediction
    beside : further columns (m, q), those of at most one of which are among the unknowns, too: of
        the one that leaves the smallest sum, ln j counted for each column
    """
    presses = int(press.max()) + 1
    by_unknowns = _per_press(press, own, jacobian)
    values = _per_press(press, own, residual[:, None])[:, 0]
    best, error = np.inf, None
    for columns in (jacobian[:, :0], *beside):
        matrix = np.hstack([by_unknowns, _per_press(press, own, columns)])
        if matrix.shape[1] > settings.unknowns * presses:
            continue
        left = trimmed_residual(matrix, values, settings)
        kept = np.sort(left**2)[: int(np.ceil(settings.kept * presses))]
        if (worth := float(kept.sum() + np.log(presses) * columns.shape[1])) < best:
            best, error = worth, left
    if error is None:
        return np.zeros(0, dtype=int)
    scale = 1.4826 * float(np.median(np.abs(error)))
    apart = np.flatnonzero(np.abs(error) > settings.sigmas * max(scale, 1.0))
    few = len(apart) <= (1 - settings.kept) * presses
    return apart if few and scale <= settings.scale else apart[:0]


def trimmed_residual(
    matrix: np.ndarray, values: np.ndarray, settings: TrimmedSettings = TRIMMED
) -> np.ndarray:
    """Residual (j,) of values (j,) against a matrix (j, k), of least trimmed squares.

    Each over its own error, beside the values' own: that of a row outside the trimmed sum has the
    error of its prediction, too. The random sets are the same at every call.
    """
    rows, unknowns = matrix.shape
    kept = max(int(np.ceil(settings.kept * rows)), min(unknowns + 1, rows))
    rng = np.random.default_rng(0)

    def concentrated(chosen: np.ndarray, steps: int) -> tuple[float, np.ndarray, np.ndarray]:
        for _ in range(steps):
            found = np.linalg.lstsq(matrix[chosen], values[chosen], rcond=None)[0]
            residual = values - matrix @ found
            chosen = np.argpartition(residual**2, kept - 1)[:kept]
        return float(np.sum(residual[chosen] ** 2)), chosen, residual

    first = min(unknowns + 1, rows)
    sets = (rng.choice(rows, first, replace=False) for _ in range(settings.starts))
    best = min((concentrated(chosen, settings.steps) for chosen in sets), key=lambda c: c[0])
    _, chosen, residual = concentrated(best[1], settings.last_steps)
    inverse = np.linalg.pinv(matrix[chosen].T @ matrix[chosen], hermitian=True)
    leverage = np.einsum("jk,kl,jl->j", matrix, inverse, matrix)
    inside = np.isin(np.arange(rows), chosen)
    variance = np.where(inside, 1 - leverage, 1 + leverage)
    return residual / np.sqrt(np.maximum(variance, 1e-3))
