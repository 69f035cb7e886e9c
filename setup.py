"""What pyproject.toml cannot say: the repository's root is the package mbsbench; the packages below it are found."""

from setuptools import find_packages, setup

PARTS = ("cli", "harness", "problems", "reports", "solvers")
folders = find_packages(include=[*PARTS, *(f"{part}.*" for part in PARTS)])
packages = ["mbsbench", *(f"mbsbench.{folder}" for folder in folders)]
setup(package_dir={"mbsbench": "."}, packages=packages, script_name="setup.py")  # so named, it is no module of ours
