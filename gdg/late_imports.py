"""Libraries that are imported when they are first used, though another imports them at once."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any


class _Late(ModuleType):
    """Stands for a module until something of it is asked for."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        if sys.modules.get(self.__name__) is self:
            raise ImportError(f"{self.__name__} is used while it is imported in name only")
        return getattr(importlib.import_module(self.__name__), name)


def import_without(library: str, package: str, *modules: str) -> ModuleType:
    """Imports a library, and modules of a package that it names only when they are used.

    For a library that imports, along with what is needed, what takes a second and mostly is not. If
    it cannot do without, it is imported with all it asks for. A package that was imported before
    stays as it is; other threads should not import it meanwhile.

    Args:
        library: what is wanted.
        package: top-level name of what takes long.
        modules: of the package, the only ones that the library names when it is imported.
    """
    if library in sys.modules or package in sys.modules:
        return importlib.import_module(library)
    try:
        with _in_name_only(package, *modules):
            return importlib.import_module(library)
    except Exception:  # another release of it may do more with the package than import it
        for name in [name for name in sys.modules if f"{name}.".startswith(f"{library}.")]:
            del sys.modules[name]
        return importlib.import_module(library)


@contextmanager
def _in_name_only(package: str, *modules: str) -> Iterator[None]:
    stand_in = ModuleType(package)
    stand_in.__path__ = []
    names = {package: stand_in}
    for module in modules:
        names[f"{package}.{module}"] = _Late(f"{package}.{module}")
        setattr(stand_in, module, names[f"{package}.{module}"])
    for name, one in names.items():
        one.__spec__ = ModuleSpec(name, None)
    sys.modules.update(names)
    try:
        yield
    finally:
        for name in names:
            sys.modules.pop(name, None)
