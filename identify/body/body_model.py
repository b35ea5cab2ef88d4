"""The finite element models of one body under the presses of one scan."""

from dataclasses import dataclass

from fem import PalpationModel, RefinedModel


@dataclass(frozen=True)
class BodyModel:
    """The model that is searched with, and the one that its result must agree with.

    Attributes
    ----------
    search : quick, cruder than `coarse` and without the near field of the presses: starts are
        tried on it
    coarse : with near field and derivatives; the fit corrects it towards `fine`
    fine : of a block two meshes extrapolated, right to 0.2 to 1 %, see `RefinedModel`; of a closed
        surface the finer mesh as it is, right to about 0.3 % where cells of size h cut off little
        of a curve of radius R under a tip of radius a, h^2/(8 R) << a. Convex facets are felt too
        hard: a dome of 50 mm under a tip of 3 mm by 1.4 % on cells of 8 mm, by 5 % on 12 mm. Meshes
        of one surface differ at random (each cuts its corners elsewhere), so that an extrapolation
        would add to the error
    note : what stands in for what, for the reader of a report; empty where nothing does
    """

    search: PalpationModel
    coarse: PalpationModel
    fine: PalpationModel | RefinedModel
    note: str
