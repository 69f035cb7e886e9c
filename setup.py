"""What pyproject.toml cannot say: the repository's root is the package mbsbench, its folders are found."""

from setuptools import find_packages, setup

FOLDERS = find_packages(".", include=[f"{top}{below}" for top in ("harness", "problems", "reports", "solvers") for below in ("", ".*")])
setup(package_dir={"mbsbench": "."}, packages=["mbsbench", *(f"mbsbench.{folder}" for folder in FOLDERS)])
