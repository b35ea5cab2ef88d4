"""Label volumes: places of voxels, frames, files of three kinds, and what is refused."""

import nibabel
import numpy as np
import pytest
import pyvista

from models import InputError, LabelVolume
from palpmap.study.label_file import read_label_volume

LABELS = np.arange(24).reshape(4, 3, 2) % 5


HEADER = (
    "ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
    "Offset = 0.01 0.02 0.03\nElementSpacing = 0.001 0.002 0.003\nDimSize = 4 3 2\n"
    "ElementType = MET_SHORT\nElementDataFile = LOCAL\n"
)


def volume(spacing=(1e-3, 2e-3, 3e-3), origin=(0.01, 0.02, 0.03)) -> LabelVolume:
    return LabelVolume.of(LABELS, np.column_stack([np.diag(spacing), origin]))


def test_a_point_has_the_label_of_its_voxel_in_every_frame():
    made, shift = volume(), np.array([0.1, -0.2, 0.05])
    centre = np.array([0.01 + 2e-3, 0.02 + 2e-3, 0.03 + 3e-3])  # of voxel (2, 1, 1)
    for away in ([0, 0, 0], [4e-4, -9e-4, 1.4e-3]):
        assert made.at([centre + away]) == LABELS[2, 1, 1]
        assert made.moved(shift).at([centre + away + shift]) == LABELS[2, 1, 1]
    assert made.covers(np.array([centre, centre + np.array([0.01, 0, 0])])).tolist() == [
        True,
        False,
    ]


def test_a_part_and_plain_data_have_the_same_labels():
    made = volume()
    box = np.array([[0.0109, 0.0201, 0.0299], [0.0121, 0.0239, 0.0331]])
    part = made.cropped(box)
    points = np.random.default_rng(0).uniform(*box, size=(200, 3))
    assert (part.at(points) == made.at(points)).all()
    again = LabelVolume.from_dict(part.to_dict())
    assert (again.at(points) == made.at(points)).all()
    fine = LabelVolume.of(
        np.zeros((400, 3, 2), int), np.column_stack([np.eye(3) * 1e-3, np.zeros(3)])
    )
    assert max(fine.cropped(np.array([[0, 0, 0], [0.4, 0.003, 0.002]])).labels.shape) <= 128


@pytest.mark.parametrize("kind", ["points.vti", "cells.vti", "labels.mha"])
def test_images_are_read_with_their_places(tmp_path, kind):
    path, cells = tmp_path / kind, kind.startswith("cells")
    image = pyvista.ImageData(
        dimensions=np.array(LABELS.shape) + cells,
        spacing=(1e-3, 2e-3, 3e-3),
        origin=np.array([0.01, 0.02, 0.03]) - cells * np.array([5e-4, 1e-3, 1.5e-3]),
    )
    data = image.cell_data if cells else image.point_data
    data["tissue"] = LABELS.ravel(order="F").astype(np.int16)
    if kind.endswith(".vti"):
        image.save(path)
    else:
        path.write_bytes(HEADER.encode() + LABELS.ravel(order="F").astype("<i2").tobytes())
    found = read_label_volume(path)
    points = np.random.default_rng(1).uniform((0.01, 0.02, 0.03), (0.013, 0.024, 0.033), (99, 3))
    assert (found.at(points) == volume().at(points)).all()


def test_nifti_has_millimetres_and_any_orientation(tmp_path):
    turned = np.array([[0, -2.0, 0, 20], [1.0, 0, 0, 10], [0, 0, 3.0, 30], [0, 0, 0, 1]])
    nibabel.save(nibabel.Nifti1Image(LABELS.astype(np.int16), turned), tmp_path / "a.nii.gz")
    found = read_label_volume(tmp_path / "a.nii.gz")
    place = 1e-3 * (turned @ [2, 1, 1, 1])[:3]
    assert found.at([place]) == LABELS[2, 1, 1]


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (np.linspace(0, 1, 24), "found values between whole numbers"),
        (np.arange(64), "found 64 labels, expected at most 50"),
    ],
)
def test_an_image_is_no_segmentation(tmp_path, values, said):
    image = pyvista.ImageData(dimensions=(len(values), 1, 1))
    image.point_data["labels"] = values
    image.save(tmp_path / "image.vti")
    with pytest.raises(InputError, match=said):
        read_label_volume(tmp_path / "image.vti")


def test_files_that_are_none_are_one_sentence(tmp_path):
    (tmp_path / "broken.vti").write_text("no XML", encoding="utf-8")
    (tmp_path / "broken.nii").write_text("no image", encoding="utf-8")
    for name, said in (
        ("absent.vti", "no such file"),
        ("labels.csv", "expected a label volume"),
        ("broken.nii", "cannot be read as a label volume"),
        ("broken.vti", "broken.vti: "),
    ):
        with pytest.raises(InputError, match=said):
            read_label_volume(tmp_path / name)
