"""Arguments that are checked: what a signature says is what a call accepts, and every refusal reads the same."""

from sb3_hucrl.checks.errors import ArgumentError, SignatureError, did_you_mean, within
from sb3_hucrl.checks.kinds import (
    Count,
    Factor,
    Fraction,
    Location,
    Natural,
    NotNegative,
    Positive,
    Probability,
    Real,
    Seed,
)
from sb3_hucrl.checks.signatures import arguments_of
from sb3_hucrl.checks.validation import require_arguments, validated

__all__ = [
    "ArgumentError",
    "Count",
    "Factor",
    "Fraction",
    "Location",
    "Natural",
    "NotNegative",
    "Positive",
    "Probability",
    "Real",
    "Seed",
    "SignatureError",
    "arguments_of",
    "did_you_mean",
    "require_arguments",
    "validated",
    "within",
]
