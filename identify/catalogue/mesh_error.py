"""The model's own discretisation error."""

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import percent


class MeshError(Effect):
    """Not physics: the error of the finite elements, as estimated from two meshes."""

    name = "mesh_error"
    title = "Error of the mesh"
    summary = (
        "The finite element mesh is too coarse, and the model a little too stiff where strains "
        "are steep. This is a fault of the computation, not of the body or of the robot."
    )
    formula = "C -> C + share (estimated error of C), the estimate from two meshes"
    latex = (
        r"C \to C + \text{share} \cdot \delta C, \quad \delta C \text{ estimated from two "
        r"meshes}"
    )
    source = "L. F. Richardson, Phil. Trans. R. Soc. A 210 (1911) 307-357 (two meshes)"
    gives_away = "the misfit follows the model's own estimate of its error from press to press"
    cure = "Take finer cells (cell_size_m under [body] in the study), or a wider tip."
    parameters = (EffectParameter("share", "1", "of the estimated error", 0.0, -50.0, 50.0, 1.0),)
    examples = (
        WorkedExample("The whole estimated error.", {"share": 1.0}, {}, {"mesh_error_share": 1.0}),
    )

    def body(self, state: BodyState, *, share: float) -> BodyState:
        """Add a share of the error."""
        return state.changed(mesh_error_share=state.mesh_error_share + share)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say the share of the estimated error in the data."""
        return (
            f"The misfit has the pattern of the mesh's own error, {percent(values['share'])} of "
            "its estimated size: take finer cells (cell_size_m under [body] in the study) before "
            "any physics is blamed."
        )
