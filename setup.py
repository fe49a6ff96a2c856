"""Where the packages are: the folders at the top of the repository are imported below `lagrange_bench`.

The rest is in pyproject.toml, which can map folders to names, but cannot find the packages inside them.
"""

from setuptools import find_packages, setup

ROOMS = ("integrators", "experiments", "results", "report")

setup(
    package_dir={f"lagrange_bench.{room}": room for room in ROOMS},
    packages=[
        *find_packages(include=["lagrange_bench", "lagrange_bench.*"]),
        *(f"lagrange_bench.{name}" for room in ROOMS for name in find_packages(include=[room, f"{room}.*"])),
    ],
)
