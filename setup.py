"""The package list: folders are renamed on import, which ``packages.find`` cannot express."""

from setuptools import find_packages, setup

RENAMED = {"plugins": "gdg_plugins", "hands": "gdg_hands", "objects": "gdg_objects"}
packages = ["gdg", *(f"gdg.{name}" for name in find_packages("gdg"))]
for folder, name in RENAMED.items():
    packages += [name, *(f"{name}.{sub}" for sub in find_packages(folder))]
setup(packages=packages)
