"""Set options that pyproject.toml cannot: the repository's root is the package mbsbench, with the packages below it."""

from setuptools import find_packages, setup

PARTS = ("cli", "harness", "problems", "reports", "solvers")
folders = find_packages(include=[*PARTS, *(f"{part}.*" for part in PARTS)])
packages = ["mbsbench", *(f"mbsbench.{folder}" for folder in folders)]
# under this name it is not packaged as a module
setup(package_dir={"mbsbench": "."}, packages=packages, script_name="setup.py")
