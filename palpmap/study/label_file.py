"""Label volumes from files: VTI, MetaImage, NIfTI."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from models import InputError, LabelVolume
from palpmap.study.study import Map

MOST_LABELS = 50  # beyond, a file is an image and no segmentation
LARGEST_VOLUME_M = 3.0  # of a file without a stated unit: a longer one is in millimetres
SUFFIXES = (".vti", ".mha", ".mhd", ".nii", ".nii.gz")


def read_label_volume(path: str | Path, unit_m: float | None = None) -> LabelVolume:
    """Read a segmentation from VTI, MetaImage or NIfTI.

    Parameters
    ----------
    path : file; of VTI the only array of whole numbers, or the one named "labels"
    unit_m : length of the file's unit, m; None takes mm for NIfTI and m for the others

    Raises
    ------
    InputError
        The file cannot be read, or holds no labels: what was found and what is expected.
    """
    path = Path(path)
    name = path.name.lower()
    suffix = next((s for s in SUFFIXES if name.endswith(s)), None)
    if suffix is None:
        raise InputError(
            f"{path}: expected a label volume ({', '.join(SUFFIXES)}); save the segmentation as "
            "one of these"
        )
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected a label volume; check the path")
    nifti = suffix.startswith(".nii")
    try:
        labels, to_place = (_nifti if nifti else _image)(path)
    except InputError:
        raise
    except Exception as error:
        raise InputError(
            f"{path}: cannot be read as a label volume ({error}); write it once more"
        ) from error
    values = np.asarray(labels)
    if not np.all(np.isfinite(values)) or np.any(values != np.rint(values)):
        raise InputError(f"{path}: found values between whole numbers, expected labels; an image "
                         "must be segmented first")  # fmt: skip
    if (count := len(np.unique(values))) > MOST_LABELS:
        raise InputError(
            f"{path}: found {count} labels, expected at most {MOST_LABELS}; an image must be "
            "segmented first"
        )
    scale = unit_m if unit_m is not None else 1e-3 if nifti else 1.0
    return LabelVolume.of(values.astype(np.int32), scale * to_place)


def regions_of(
    study_map: Map, points_m: np.ndarray, box_m: np.ndarray, origin_m: np.ndarray
) -> LabelVolume | None:
    """Return the label volume of a study's map in the body's frame, None without one.

    Parameters
    ----------
    points_m : (p, 3) points of the body, which the volume must cover
    box_m : (2, 3) of the body
    origin_m : (3,) of the body's frame in that of the scan

    Raises
    ------
    InputError
        It cannot be read, does not cover the body, or looks like millimetres.
    """
    file = study_map.regions
    if file is None:
        return None
    volume = read_label_volume(file, study_map.regions_unit_m)
    longest = float(np.max(volume.edges_m))
    if study_map.regions_unit_m is None and longest > LARGEST_VOLUME_M:
        raise InputError(
            f"{file}, key map.regions: found a volume {longest:.4g} m long, expected at most "
            f"{LARGEST_VOLUME_M:g} m; this looks like millimetres: set map.regions_unit_m = 0.001 "
            "(if the file is in metres, set it to 1)"
        )
    volume = volume.moved(-np.asarray(origin_m))
    covered = volume.covers(points_m)
    if not covered.all():
        low, high = 1e3 * (box_m + origin_m)
        raise InputError(
            f"{file}, key map.regions: covers {100 * covered.mean():.0f} % of the body, expected "
            f"all of it ({low[0]:.0f} to {high[0]:.0f}, {low[1]:.0f} to {high[1]:.0f} and "
            f"{low[2]:.0f} to {high[2]:.0f} mm in the scan's frame); check origin, orientation and "
            "map.regions_unit_m"
        )
    return volume


def _image(path: Path) -> tuple[np.ndarray, np.ndarray]:
    import pyvista

    image = pyvista.read(path)
    if not isinstance(image, pyvista.ImageData):
        raise InputError(f"{path}: found {type(image).__name__}, expected an image of voxels")
    to_place = np.asarray(image.index_to_physical_matrix, float)[:3].copy()
    for cells, data in ((1, image.cell_data), (0, image.point_data)):
        named = _whole(data)
        if named is not None:
            to_place[:, 3] += to_place[:, :3] @ np.full(3, cells / 2)  # the centre of a cell
            return named.reshape(np.array(image.dimensions) - cells, order="F"), to_place
    raise InputError(
        f"{path}: found no array of whole numbers, or several and none named 'labels'; name it so"
    )


def _whole(data) -> np.ndarray | None:
    names = [n for n in data if np.ndim(data[n]) == 1]
    whole: Callable[[str], bool] = lambda n: np.issubdtype(data[n].dtype, np.integer)  # noqa: E731
    names = ["labels"] if "labels" in names else [n for n in names if whole(n)] or names
    return np.asarray(data[names[0]]) if len(names) == 1 else None


def _nifti(path: Path) -> tuple[np.ndarray, np.ndarray]:
    try:
        import nibabel
    except ImportError as error:
        raise InputError(
            f"{path}: NIfTI needs nibabel; install palpmap[import], or save the labels as .vti"
        ) from error
    image = nibabel.Nifti1Image.from_filename(path)
    return np.asarray(image.dataobj), np.asarray(image.affine)[:3]
