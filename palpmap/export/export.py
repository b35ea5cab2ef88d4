"""A run's map written for another program."""

from __future__ import annotations

from pathlib import Path

from models import InputError, replaced
from palpmap.export.body import ExportedBody
from palpmap.export.febio import write_febio
from palpmap.export.mujoco import write_mujoco
from palpmap.export.vtk import write_csv, write_vti, write_vtu
from palpmap.results import Run

WRITERS = {"vtu": write_vtu, "vti": write_vti, "febio": write_febio, "csv": write_csv}
ENDINGS = {"vtu": ".vtu", "vti": ".vti", "febio": ".feb", "mujoco": ".xml", "csv": ".csv"}
FORMS = tuple(ENDINGS)
DEFAULT_NAMES = {"vti": "map_grid"}  # map.vti is a free map's own, with its band


def export_run(run: Run, form: str, path: Path | None = None) -> tuple[Path, list[str]]:
    """Write the map of a run, in the scan's frame.

    Parameters
    ----------
    run : with a fit, see `palpmap.api.read_run`
    form : one of `FORMS`
    path : file to write; by default `map` in the run's folder with the form's ending, see
        `DEFAULT_NAMES`

    Returns
    -------
    path : that was written; of mujoco the MJCF file, with a .npz beside it
    said : what the file does not hold, and how far it agrees with the fit

    Raises
    ------
    InputError
        A wrong ending, or a file that cannot be written.
    """
    ending = ENDINGS[form]
    path = path or run.folder / f"{DEFAULT_NAMES.get(form, 'map')}{ending}"
    if path.suffix.lower() != ending:
        raise InputError(f"{path}: expected a file that ends in {ending} for --to {form}")
    body = ExportedBody.of(run)
    said = [] if form in ("vtu", "vti", "csv") else body.left_out
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if form == "mujoco":
            found = write_mujoco(body, path)
            said.append(
                f"{path.with_suffix('.npz').name} beside it has the modulus of each element and "
                "belongs to it: keep both, and read them with palpmap.load_mujoco."
            )
            said.append(
                f"Poisson's ratio is {found.poisson_ratio:g} and all moduli were multiplied by "
                f"{found.factor:.3f}, as MuJoCo's elements have four nodes; the compliance of each "
                f"press is then that of the fit to {100 * found.largest:.1f} %."
            )
        else:
            with replaced(path, f".part{ENDINGS[form]}") as beside:
                WRITERS[form](body, beside)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror}); check --out") from error
    return path, said
