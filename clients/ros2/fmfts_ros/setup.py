"""colcon builds ament_python packages with this file; a pyproject.toml beside it would make colcon fail."""

from setuptools import setup

NAME = "fmfts_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/fmfts.launch.py"]),
        (f"share/{NAME}/config", ["config/fmfts.yaml"]),
    ],
    install_requires=["setuptools", "fmfts-client>=0.1.0"],
    zip_safe=True,
    description="Publishes the contacts of fmfts-daemon's tactile pads in ROS 2",
    license="MIT",
    entry_points={"console_scripts": [f"fmfts = {NAME}.main:main"]},
)
