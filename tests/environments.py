"""Builds packages and installs them into fresh environments, without a network.

A fresh environment is a real one: its own Python, its own pip, which resolves what a package needs.
Only the downloads are replaced: pip finds gdg's wheel in a folder, and everything that gdg itself
needs on ``PYTHONPATH``, where this environment's other packages are linked.
"""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path


def run(*command: str, cwd: Path, **environment: str) -> str:
    """What a command prints; fails with all that it said when it fails."""
    finished = subprocess.run(
        command, cwd=cwd, capture_output=True, text=True, check=False,
        env={**os.environ, **environment},
    )  # fmt: skip
    assert finished.returncode == 0, finished.stdout + finished.stderr
    return finished.stdout


def build(source: Path, out: Path, kind: str) -> Path:
    """Builds the ``wheel`` or ``sdist`` of a source tree (and litters it)."""
    run(sys.executable, "-m", "build", "--no-isolation", f"--{kind}", "-o", str(out), cwd=source)
    (built,) = out.iterdir()
    return built


def link_other_packages(folder: Path) -> Path:
    """Links all packages of this environment but gdg and pip into a folder."""
    folder.mkdir()
    for name in ("purelib", "platlib"):
        for path in Path(sysconfig.get_path(name)).iterdir():
            stem = path.name.split("-")[0].lower()
            ours = "gdg" in stem or stem == "pip"
            if not ours and path.suffix != ".pth" and not (folder / path.name).exists():
                (folder / path.name).symlink_to(path)
    return folder


def no_network(wheels: Path, others: Path) -> dict[str, str]:
    """Variables with which pip and Python find packages in these folders and nowhere else."""
    return {
        "PYTHONPATH": str(others),
        "PIP_NO_INDEX": "1",
        "PIP_FIND_LINKS": str(wheels),
        "PIP_NO_BUILD_ISOLATION": "0",  # pip reads 0 as: no isolation
        "PIP_NO_CACHE_DIR": "1",
        "PIP_DISABLE_PIP_VERSION_CHECK": "1",
    }


@dataclass(frozen=True)
class Environment:
    """A virtual environment.

    Attributes:
        folder: where it lies.
        variables: the environment variables with which it is active.
    """

    folder: Path
    variables: Mapping[str, str]

    @classmethod
    def create(cls, folder: Path, variables: Mapping[str, str]) -> Environment:
        """An environment with nothing but pip, active with the given variables."""
        run(sys.executable, "-m", "venv", str(folder), cwd=folder.parent)
        path = f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}"
        return cls(folder, {**variables, "VIRTUAL_ENV": str(folder), "PATH": path})

    def run(self, program: str, *arguments: str, cwd: Path, **environment: str) -> str:
        """What one of the environment's own programs prints."""
        command = (str(self.folder / "bin" / program), *arguments)
        return run(*command, cwd=cwd, **{**self.variables, **environment})
