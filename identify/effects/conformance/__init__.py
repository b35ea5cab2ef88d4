"""The conformance kit: the checks that every effect passes."""

from identify.effects.conformance.kit import CheckResult, check_effect, failures

__all__ = ["CheckResult", "check_effect", "failures"]
