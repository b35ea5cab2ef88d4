"""A fitted map in the forms of other programs: ParaView, FEBio, MuJoCo, tables."""

from palpmap.export.export import FORMS, export_run
from palpmap.export.mujoco import load_mujoco

__all__ = ["FORMS", "export_run", "load_mujoco"]
