"""Builds tf2_msgs, which PyPI lacks, with the generators and headers of the ROS wheels; ROS installations have it."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

# The whole of tf2_msgs/msg/TFMessage, in the language of ROS's generators.
TF_MESSAGE = """\
#include "geometry_msgs/msg/TransformStamped.idl"

module tf2_msgs {
  module msg {
    struct TFMessage {
      sequence<geometry_msgs::msg::TransformStamped> transforms;
    };
  };
};
"""
# Each generator writes into a folder of its own: some of their files have the same name.
GENERATE = """
import sys
from pathlib import Path
from rosidl_generator_c.cli import GenerateC
from rosidl_generator_py.cli import GeneratePython
from rosidl_typesupport_c.cli import GenerateCTypesupport
from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

source = Path(sys.argv[1])
for name, generator in {
    "c": GenerateC, "py": GeneratePython, "support": GenerateCTypesupport, "fastrtps": GenerateFastRTPSCTypesupport,
    "introspection": GenerateIntrospectionCTypesupport,
}.items():
    (source / name / "tf2_msgs").mkdir(parents=True)
    generator(name).generate(
        package_name="tf2_msgs", interface_files=[f"{source}:msg/TFMessage.idl"],
        include_paths=[str(Path(sys.prefix, "share"))], output_path=source / name / "tf2_msgs",
    )
"""
SUPPORTS = ("rosidl_typesupport_c", "rosidl_typesupport_fastrtps_c")
OPTIONS = ["-O1", "-fPIC", "-shared", "-w", "-Wl,--allow-shlib-undefined"]


def build_tf2_msgs(place: Path) -> None:
    """place: an environment with ROS's wheels, into which the result goes."""
    generated, libraries = place / "tf2", place / "lib"
    (packages,) = libraries.glob("python3*/site-packages")
    (generated / "msg").mkdir(parents=True)
    (generated / "msg/TFMessage.idl").write_text(TF_MESSAGE)
    run(place / "bin/python", "-c", GENERATE, generated, environment=os.environ | {"AMENT_PREFIX_PATH": str(place)})
    builder = Builder(generated, libraries, [*headers(place), packages / "numpy/_core/include"])
    messages, c = "msg/detail/tf_message__", "tf2_msgs__rosidl_generator_c"
    geometry = "geometry_msgs__rosidl_"
    parts = [f"c:{messages}{part}.c" for part in ("functions", "description", "type_support")]
    builder.library("rosidl_generator_c", parts, f"{geometry}generator_c", "rosidl_runtime_c")
    fastrtps = [f"{geometry}typesupport_fastrtps_c", SUPPORTS[1], "rosidl_typesupport_fastrtps_cpp", "fastcdr"]
    builder.library(SUPPORTS[1], [f"fastrtps:{messages}type_support_c.cpp"], c, *fastrtps)
    introspection = "rosidl_typesupport_introspection_c"
    needed = [f"{geometry}typesupport_introspection_c", introspection]
    builder.library(introspection, [f"introspection:{messages}type_support.c"], c, *needed)
    needed = [f"tf2_msgs__{SUPPORTS[1]}", SUPPORTS[0]]
    builder.library(SUPPORTS[0], ["support:msg/tf_message__type_support.cpp"], c, *needed)
    builder.library("rosidl_generator_py", ["py:msg/_tf_message_s.c"], c, f"{geometry}generator_py")

    package = packages / "tf2_msgs"
    shutil.copytree(generated / "py/tf2_msgs", package, ignore=shutil.ignore_patterns("*.c"))
    (package / "__init__.py").touch()
    for support in SUPPORTS:
        extension = package / f"tf2_msgs_s__{support}.so"
        source = f"py:_tf2_msgs_s.ep.{support}.c"
        builder.build(extension, [source], f"tf2_msgs__{support}", "tf2_msgs__rosidl_generator_py")


def headers(place: Path) -> list[Path]:
    """Folders of the wheels' headers, and of Python's."""
    question = "import sysconfig; print(sysconfig.get_path('include'))"
    said = subprocess.run([place / "bin/python", "-c", question], check=True, capture_output=True, text=True)
    include = place / "include"
    return [include, *(each for each in include.iterdir() if each.is_dir()), Path(said.stdout.strip())]


class Builder:
    """Compiles what is in `generated` against the environment's `libraries`. A source is "GENERATOR:FILE"."""

    def __init__(self, generated: Path, libraries: Path, folders: list[Path]) -> None:
        self._generated, self._libraries = generated, libraries
        folders = [*(each for each in generated.iterdir() if each.is_dir()), *folders]
        self._options = [*OPTIONS, *(f"-I{folder}" for folder in folders)]
        self._options += [f"-L{libraries}", f"-Wl,-rpath,{libraries}"]

    def library(self, name: str, sources: list[str], *needed: str) -> None:
        self.build(self._libraries / f"libtf2_msgs__{name}.so", sources, *needed)

    def build(self, output: Path, sources: list[str], *needed: str) -> None:
        files = [
            self._generated / folder / "tf2_msgs" / name for folder, _, name in (s.partition(":") for s in sources)
        ]
        compiler = "g++" if files[0].suffix == ".cpp" else "gcc"
        run(compiler, *self._options, *files, "-o", output, *(f"-l{name}" for name in needed))


def run(*words: str | Path, environment: dict[str, str] | None = None) -> None:
    ended = subprocess.run(list(map(str, words)), env=environment, capture_output=True, text=True, check=False)
    if ended.returncode != 0:
        raise RuntimeError(f"{words[0]} ended with {ended.returncode}:\n{ended.stdout[-2000:]}{ended.stderr[-4000:]}")
