"""The bill of materials of a release (SBOM, CycloneDX 1.6 as JSON): `make dist` writes it beside the files it is about.

Each file of dist/ is a component with its hash. Inside it stand the parts of others that it carries; what it needs from
elsewhere are components beside it, with the versions and hashes of constraints.txt. The firmware, which users build, is
a component too. The same commit and files give the same bytes.
"""

from __future__ import annotations

import hashlib
import json
import re
import tomllib
import uuid
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
HERE = Path(__file__).parent
DEBIAN = ROOT / "systemd/debian"
Component = dict[str, Any]
# lines of a requirements file, joined: name==version ; marker --hash=sha256:… --hash=…
PINNED = re.compile(r"^([\w.-]+)==(\S+)(.*)$", re.MULTILINE)


def bill(dist: Path, time_s: int) -> dict[str, Any]:
    """The document about what is in `dist`."""
    parts = tomllib.loads((HERE / "parts.toml").read_text())
    licences = parts["licences"]
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    whole = component("application", "fmfts", version, "MIT", "fmfts")
    needed = [pinned(*each, licences) for each in requirements(HERE / "constraints.txt")]
    of_extras = needs_of_extras(licences, needed)
    several = {part["bom-ref"]: part for own in of_extras.values() for part in own}  # of which some need the same
    debian = [on_debian(name, least, licences) for name, least in debian_dependencies()]
    vendored = [of_npm(part) for part in parts["vendored"]]
    carried = [pinned(*each, licences) for each in requirements(DEBIAN / "vendored.txt")]
    files = [file_component(path, version, vendored, carried) for path in sorted(dist.glob("fmfts*")) if is_part(path)]
    firmware = firmware_components(version, parts["firmware"])
    of_index, of_debian = [part["bom-ref"] for part in needed], [part["bom-ref"] for part in debian]
    depends = [{"ref": "fmfts", "dependsOn": [part["bom-ref"] for part in [*files, *firmware]]}]
    for part in files:
        wanted = of_debian if part["name"].endswith(".deb") else of_index
        if part["name"].startswith("fmfts_client"):
            wanted = [ref for ref in of_index if re.match(r"pkg:pypi/(pyzmq|msgpack|cffi|pycparser)@", ref)]
        own = next((parts for name, parts in of_extras.items() if part["name"].startswith(f"{name}-")), [])
        depends.append({"ref": part["bom-ref"], "dependsOn": [*wanted, *(each["bom-ref"] for each in own)]})
    described = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "timestamp": datetime.fromtimestamp(time_s, timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
            "component": whole,
        },
        "components": [*files, *firmware, *needed, *several.values(), *debian],
        "dependencies": depends,
    }
    # The same document always has the same number, and different documents have different ones.
    return {"$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json", **described} | {
        "serialNumber": f"urn:uuid:{uuid.uuid5(uuid.NAMESPACE_OID, repr(described))}"
    }


def component(kind: str, name: str, version: str, licence: str, ref: str, **more: Any) -> Component:
    versioned = {"version": version} if version else {}
    return {"type": kind, "bom-ref": ref, "name": name, **versioned, "licenses": [{"expression": licence}], **more}


def sha256(path: Path) -> list[dict[str, str]]:
    return [{"alg": "SHA-256", "content": hashlib.sha256(path.read_bytes()).hexdigest()}]


def is_part(path: Path) -> bool:
    return path.name.endswith((".whl", ".tar.gz", ".deb"))


def file_component(path: Path, version: str, vendored: list[Component], carried: list[Component]) -> Component:
    """A file of dist/, with the parts of others inside of it."""
    inside = carried if path.name.endswith(".deb") else []
    inside = [*(vendored if inside or path.name.startswith("fmfts_page-") else []), *inside]
    own = [part | {"bom-ref": f"{path.name}/{part['bom-ref']}"} for part in inside]
    found = component("file", path.name, version, "MIT", path.name, hashes=sha256(path))
    return found | ({"components": own} if own else {})


def of_npm(part: dict[str, Any]) -> Component:
    address = f"pkg:npm/{part['name'].replace('@', '%40')}@{part['version']}"
    folder = ROOT / part["folder"]
    files = [
        {"type": "file", "name": f"{part['folder']}/{name}", "hashes": sha256(folder / name)} for name in part["files"]
    ]
    return component("library", part["name"], part["version"], part["licence"], address, purl=address, components=files)


def requirements(file: Path) -> list[tuple[str, str, list[str]]]:
    """Name, version and hashes of each package in a requirements file."""
    joined = file.read_text().replace("\\\n", " ")
    return [
        (name, version, re.findall(r"sha256:([0-9a-f]{64})", rest)) for name, version, rest in PINNED.findall(joined)
    ]


def pinned(name: str, version: str, hashes: list[str], licences: dict[str, str]) -> Component:
    """A package of the Python index; one hash for each of its files."""
    address = f"pkg:pypi/{name}@{version}"
    listed = [{"alg": "SHA-256", "content": each} for each in hashes]
    return component("library", name, version, licences[name], address, purl=address, hashes=listed)


def needs_of_extras(licences: dict[str, str], needed: list[Component]) -> dict[str, list[Component]]:
    """The requirements of each package of extras/ besides the daemon's, by the beginning of its files' names."""
    tested = requirements(HERE / "constraints-extras.txt")
    known = {part["name"] for part in needed}
    found = {}
    for path in sorted(ROOT.glob("extras/*/pyproject.toml")):
        project = tomllib.loads(path.read_text())["project"]
        names = [re.split(r"[^\w.-]", word)[0] for word in project["dependencies"]]
        own = [each for each in tested if each[0] in names and each[0] not in known]
        found[project["name"].replace("-", "_")] = [pinned(*each, licences) for each in own]
    return found


def debian_dependencies() -> list[tuple[str, str]]:
    """What the Debian package needs, with the least version; ${…} are the C library and what debhelper adds."""
    depends = re.search(r"^Depends:(.*?)^\S", (DEBIAN / "control").read_text(), re.DOTALL | re.MULTILINE)
    assert depends is not None
    return re.findall(r"(python3[\w-]*) \(>= ([^)]+)\)", depends[1])


def on_debian(name: str, least: str, licences: dict[str, str]) -> Component:
    """A package of Debian; its version is that of the machine, so the least one stands in a property."""
    python = {"zmq": "pyzmq", "serial": "pyserial"}
    own = name.removeprefix("python3-")
    address = f"pkg:deb/debian/{name}"
    least_of_all = [{"name": "fmfts:least-version", "value": least}]
    return component(
        "library", name, "", licences[python.get(own, own)], address, purl=address, properties=least_of_all
    )


def firmware_components(version: str, linked: list[dict[str, str]]) -> list[Component]:
    found = []
    for board in ("stm32f103", "rp2040"):
        ref = f"firmware/{board}"
        inside = [
            component("library", part["name"], "", part["licence"], f"{ref}/{part['name']}")
            for part in linked
            if part["board"] == board
        ]
        found.append(
            component("firmware", f"fmfts-{board}", version, "MIT", ref) | ({"components": inside} if inside else {})
        )
    return found


def written_bill(dist: Path, time_s: int) -> Path:
    """Writes the document. SystemExit if it does not keep to CycloneDX's schema."""
    document = bill(dist, time_s)
    text = json.dumps(document, indent=1, ensure_ascii=False) + "\n"
    if fault := fault_of(text):
        raise SystemExit(f"the bill of materials is no CycloneDX: {fault}")
    path = dist / f"fmfts-{document['metadata']['component']['version']}.cdx.json"
    path.write_text(text)
    return path


def fault_of(text: str) -> str:
    """The fault that CycloneDX's schema finds; "" if there is none."""
    from cyclonedx.schema import SchemaVersion
    from cyclonedx.validation.json import JsonStrictValidator

    fault = JsonStrictValidator(SchemaVersion.V1_6).validate_str(text)
    return "" if fault is None else str(fault)
