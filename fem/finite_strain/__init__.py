"""Hyperelastic bodies at finite strain: laws, load stepping, tips."""

from fem.finite_strain.hyperelastic import Fung, HyperelasticLaw, NeoHookean, Yeoh
from fem.finite_strain.model import FiniteStrainModel
from fem.finite_strain.tips import RigidTip

__all__ = ["FiniteStrainModel", "Fung", "HyperelasticLaw", "NeoHookean", "RigidTip", "Yeoh"]
