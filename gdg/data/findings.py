"""What a check of a dataset found. Light."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal


@dataclass(frozen=True)
class FileFinding:
    """One thing that is wrong with, or odd about, a file of a dataset.

    Attributes:
        severity: an ``error`` makes results wrong; a ``warning`` may be as it should.
        path: the file.
        text: what is wrong, in one sentence.
        damaged: no run of gdg wrote the file as it is: it is of no use, and is best made again.
    """

    severity: Literal["error", "warning"]
    path: Path
    text: str
    damaged: bool = False

    def __str__(self) -> str:
        return f"{self.path}: {self.text}"
