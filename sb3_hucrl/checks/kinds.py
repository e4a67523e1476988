"""Kinds of values, mostly ranges of numbers, for signatures. A description is what an error tells the user to give."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

from pydantic import Field

Count: TypeAlias = Annotated[int, Field(ge=1, description="an integer of at least 1")]
Natural: TypeAlias = Annotated[int, Field(ge=0, description="an integer of at least 0")]
#: of a file or a folder
Location: TypeAlias = str | Path
#: PyTorch's generators take 64 bits
Seed: TypeAlias = Annotated[int, Field(ge=0, lt=2**63, description="an integer from 0 to 2**63 - 1")]
Real: TypeAlias = Annotated[float, Field(description="a finite number")]
NotNegative: TypeAlias = Annotated[float, Field(ge=0, description="a finite number of at least 0")]
Positive: TypeAlias = Annotated[float, Field(gt=0, description="a finite number above 0")]
Fraction: TypeAlias = Annotated[float, Field(ge=0, le=1, description="a fraction from 0 to 1")]
Factor: TypeAlias = Annotated[float, Field(gt=0, le=1, description="a number above 0 and up to 1")]
Probability: TypeAlias = Annotated[float, Field(gt=0, lt=1, description="a probability above 0 and below 1")]
