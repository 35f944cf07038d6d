"""Which packages a wheel of indentfit holds: those found below indentfit/, and materials/ as indentfit.materials.

setuptools can either find packages or place a folder elsewhere, not both: its command that collects modules is extended here.
Used while a wheel is built, never afterwards.
"""

from setuptools import find_packages
from setuptools.command.build_py import build_py


class BuildPy(build_py):
    """setuptools' `build_py` for the packages that exist below indentfit/ and for materials/."""

    def finalize_options(self) -> None:
        self.distribution.packages = ["indentfit.materials", *find_packages(include=["indentfit", "indentfit.*"])]
        super().finalize_options()
