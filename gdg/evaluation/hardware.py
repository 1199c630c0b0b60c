"""What a time was measured on, in one line."""

from __future__ import annotations

import os
import platform
import sys
from pathlib import Path

import torch

from gdg.engine.threads import usable_cores

#: Where Linux tells the processor's model.
CPU_INFO = Path("/proc/cpuinfo")


def hardware(device: str = "cpu") -> str:
    """Processor, cores, threads of this process, GPU, versions of torch and Python.

    Args:
        device: the job's; a GPU that it does not use is not named.
    """
    threads = torch.get_num_threads()
    return ", ".join(
        (
            cpu_model(),
            f"{usable_cores()} cores",
            f"{threads} thread{'' if threads == 1 else 's'} per process",
            torch.cuda.get_device_name(device) if device.startswith("cuda") else "no GPU used",
            f"torch {torch.__version__}",
            f"Python {platform.python_version()}",
        )
    )


def load() -> float:
    """Processes that wanted a core over the last minute, per usable core; NaN if not known.

    Times of more than about 1 were taken beside other work, and are upper bounds.
    """
    if not hasattr(os, "getloadavg"):
        return float("nan")
    return os.getloadavg()[0] / usable_cores()


def cpu_model(info: Path = CPU_INFO) -> str:
    """The processor's name as the system tells it, else its architecture."""
    if sys.platform == "linux" and info.is_file():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            name, _, value = line.partition(":")
            if name.strip() in ("model name", "Model", "Hardware") and value.strip():
                return " ".join(value.split())
    return platform.processor() or platform.machine() or "unknown processor"
