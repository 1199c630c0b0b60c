"""Libraries that are imported when they are first used, though another imports them at once."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import Any


class _Late(ModuleType):
    """Stands for a module until something of it is asked for."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(importlib.import_module(self.__name__), name)


@contextmanager
def late(package: str, *modules: str) -> Iterator[None]:
    """While it lasts, these modules of a package are imported in name only.

    For a library that imports, along with what is needed, what takes a second and mostly is not.
    A package that has been imported already stays as it is.

    Args:
        package: top-level name.
        modules: of the package; others are not found meanwhile.
    """
    if package in sys.modules:
        yield
        return
    stand_in = ModuleType(package)
    stand_in.__path__ = []
    names = {package: stand_in}
    for module in modules:
        names[f"{package}.{module}"] = _Late(f"{package}.{module}")
        setattr(stand_in, module, names[f"{package}.{module}"])
    sys.modules.update(names)
    try:
        yield
    finally:
        for name in names:
            sys.modules.pop(name, None)
