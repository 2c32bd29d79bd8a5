"""What a release is accompanied by: tested versions with hashes, a bill of materials, checksums and signatures."""

from __future__ import annotations

import hashlib
import io
import json
import re
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
RELEASE = ROOT / "release"
sys.path.insert(0, str(RELEASE))

pytest.importorskip("tomllib", reason="releases are made by Python 3.11 or later")
import sbom  # noqa: E402
from constraints import requirements as needed  # noqa: E402
from dist import repack  # noqa: E402
from release import tag  # noqa: E402
from sbom import bill, requirements  # noqa: E402
from signing import sign, write_checksums  # noqa: E402

COMMITTED_S = 1_700_000_000
NOTES = "first\n\n# As a heading\n"
FILES = ["constraints.txt", "constraints-extras.txt", "constraints-build.txt"]
WHEEL, DEB, CLIENT = "fmfts-0.1.0-cp311-abi3-linux_x86_64.whl", "fmfts_0.1.0_amd64.deb", "fmfts_client-0.1.0.tar.gz"
EXTRA, PAGE = "fmfts_foxglove-0.1.0-py3-none-any.whl", "fmfts_page-0.1.0-py3-none-any.whl"


@pytest.mark.parametrize("file", FILES)
def test_tested_versions_satisfy_pyproject(file: str) -> None:
    listed: dict[str, list[str]] = {}
    for name, version, _ in requirements(RELEASE / file):
        listed.setdefault(name, []).append(version)
    wanted = [Requirement(word) for word in needed()[file]]
    assert wanted
    versions = [(each, listed.get(each.name.lower(), ["0"])) for each in wanted]
    unmet = [str(each) for each, found in versions if not all(map(each.specifier.contains, found))]
    assert unmet == [], "`make constraints` writes them anew"


@pytest.mark.parametrize("file", FILES)
def test_every_tested_version_has_hashes_and_no_address(file: str) -> None:
    text = (RELEASE / file).read_text()
    assert re.findall(r"://|--(?:extra-)?index|--find-links| @ ", text) == []
    found = requirements(RELEASE / file)
    assert len(found) == len(re.findall(r"^[\w.-]+==", text, flags=re.MULTILINE))
    assert [name for name, _, hashes in found if not hashes] == []


def test_tested_versions_hold_no_gpl() -> None:
    assert [file for file in FILES[:2] for name, _, _ in requirements(RELEASE / file) if name == "felupe"] == []


@pytest.fixture
def dist(tmp_path: Path) -> Path:
    folder = tmp_path / "dist"
    folder.mkdir()
    for name in (WHEEL, DEB, CLIENT, EXTRA, PAGE):
        (folder / name).write_text(name)
    return folder


def test_bill_of_materials_keeps_to_cyclonedx(dist: Path) -> None:
    pytest.importorskip("cyclonedx", reason="cyclonedx is missing: pip install -e clients/python -e '.[test]'")
    from sbom import fault_of

    document = bill(dist, COMMITTED_S)
    assert fault_of(json.dumps(document)) == ""
    assert fault_of(json.dumps({"bomFormat": "CycloneDX", "specVersion": 1})) != ""


def test_bill_of_materials_names_what_each_file_carries(dist: Path) -> None:
    found = {part["name"]: part for part in bill(dist, COMMITTED_S)["components"]}
    inside = {
        name: {each["name"] for each in found[name].get("components", [])} for name in (WHEEL, DEB, CLIENT, EXTRA, PAGE)
    }
    page = {"uplot", "@msgpack/msgpack"}
    assert inside == {
        WHEEL: set(),
        PAGE: page,
        DEB: page | {"onnxruntime", "msgspec", "websockets", "mcap"},
        CLIENT: set(),
        EXTRA: set(),
    }
    assert found[WHEEL]["hashes"][0]["content"] == hashlib.sha256(WHEEL.encode()).hexdigest()
    assert {"fmfts-stm32f103", "fmfts-rp2040", "numpy", "pyzmq", "python3-zmq"} <= found.keys()
    assert [each["name"] for each in found["fmfts-rp2040"]["components"]] == ["libgcc"]


def test_bill_of_materials_says_what_each_file_needs(dist: Path) -> None:
    document = bill(dist, COMMITTED_S)
    needs = {each["ref"]: set(each["dependsOn"]) for each in document["dependencies"]}
    of_index = {f"pkg:pypi/{name}@{version}": hashes for name, version, hashes in requirements(RELEASE / FILES[0])}
    assert needs[WHEEL] == of_index.keys()
    assert {ref[9:].partition("@")[0] for ref in needs[EXTRA] - needs[WHEEL]} == {"foxglove-sdk"}
    assert {ref[9:].partition("@")[0] for ref in needs[PAGE] - needs[WHEEL]} == {"websockets"}
    # pyzmq has cffi, and that pycparser, on PyPy.
    assert {ref[9:].partition("@")[0] for ref in needs[CLIENT]} == {"pyzmq", "msgpack", "cffi", "pycparser"}
    assert "pkg:deb/debian/python3-zmq" in needs[DEB]
    assert all(ref.startswith("pkg:deb/debian/python3") for ref in needs[DEB])
    assert needs["fmfts"] == {WHEEL, DEB, CLIENT, EXTRA, PAGE, "firmware/stm32f103", "firmware/rp2040"}
    found = {part["bom-ref"]: part for part in document["components"]}
    assert {ref: [each["content"] for each in found[ref]["hashes"]] for ref in of_index} == of_index
    assert found["pkg:deb/debian/python3-zmq"]["properties"][0]["value"] == "24"
    assert "components" not in found["firmware/stm32f103"]
    assert document["metadata"]["timestamp"] == "2023-11-14T22:13:20Z"  # date -u -d @1700000000


def test_faulty_bill_of_materials_is_not_written(dist: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sbom, "fault_of", lambda text: "no such licence")
    with pytest.raises(SystemExit, match="is no CycloneDX: no such licence"):
        sbom.written_bill(dist, COMMITTED_S)
    assert not list(dist.glob("*.cdx.json"))


def test_bill_of_materials_has_every_vendored_file(dist: Path) -> None:
    (wheel,) = [part for part in bill(dist, COMMITTED_S)["components"] if part["name"] == PAGE]
    named = {file["name"]: file["hashes"][0]["content"] for part in wheel["components"] for file in part["components"]}
    folder = ROOT / "extras/page/fmfts_page/static/vendor"
    there = {f"{path.relative_to(ROOT)}": path for path in folder.iterdir() if path.suffix != ".LICENSE"}
    assert named == {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in there.items()}
    manual = (ROOT / "docs/dependencies.md").read_text()
    assert [name for name, digest in named.items() if digest not in manual] == []


def test_firmware_links_no_library_but_those_in_the_bill() -> None:
    rules = "".join(path.read_text() for path in (ROOT / "firmware").glob("*/build.mk"))
    assert set(re.findall(r"(?<=\s)-l(\w+)", rules)) == {"gcc"}


def test_bill_of_materials_is_the_same_for_the_same_files(dist: Path) -> None:
    first = bill(dist, COMMITTED_S)
    assert bill(dist, COMMITTED_S) == first
    (dist / WHEEL).write_text("another")
    assert bill(dist, COMMITTED_S)["serialNumber"] != first["serialNumber"]


def test_source_archive_has_no_trace_of_its_computer(tmp_path: Path) -> None:
    for name, mode, time_s, owner in (("a.tar.gz", 0o600, 1, "me"), ("b.tar.gz", 0o664, 2, "you")):
        with tarfile.open(tmp_path / name, "w:gz") as file:
            for path in ("p/b", "p/a") if owner == "me" else ("p/a", "p/b"):
                member = tarfile.TarInfo(path)
                member.size, member.uname, member.uid = 1, owner, time_s
                member.mode = mode | 0o100 if path == "p/a" else mode
                member.mtime = time_s + 0.5  # such a time stands in an extra header
                file.addfile(member, io.BytesIO(b"x"))
        repack(tmp_path / name, COMMITTED_S)
    assert (tmp_path / "a.tar.gz").read_bytes() == (tmp_path / "b.tar.gz").read_bytes()
    with tarfile.open(tmp_path / "a.tar.gz") as file:
        assert [(each.name, each.mode, each.mtime) for each in file] == [
            ("p/a", 0o755, COMMITTED_S),
            ("p/b", 0o644, COMMITTED_S),
        ]
    written_s = int.from_bytes((tmp_path / "a.tar.gz").read_bytes()[4:8], "little")  # RFC 1952, MTIME
    assert written_s == COMMITTED_S


@pytest.fixture
def key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An SSH key that git signs with, and nothing else of this computer's settings."""
    path = tmp_path / "keys/key"
    path.parent.mkdir()
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", path], check=True)
    use_settings(monkeypatch, {"gpg.format": "ssh", "user.signingkey": str(path)})
    return path


def use_settings(monkeypatch: pytest.MonkeyPatch, settings: dict[str, str]) -> None:
    for name, value in {"GIT_CONFIG_GLOBAL": "/dev/null", "GIT_CONFIG_SYSTEM": "/dev/null"}.items():
        monkeypatch.setenv(name, value)
    settings = {"user.name": "A", "user.email": "a@example.invalid", **settings}
    monkeypatch.setenv("GIT_CONFIG_COUNT", str(len(settings)))
    for number, (name, value) in enumerate(settings.items()):
        monkeypatch.setenv(f"GIT_CONFIG_KEY_{number}", name)
        monkeypatch.setenv(f"GIT_CONFIG_VALUE_{number}", value)
    monkeypatch.delenv("SIGN", raising=False)


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    place = tmp_path / "repository"
    subprocess.run(["git", "init", "-q", place], check=True)
    return place


def committed(place: Path) -> None:
    subprocess.run(["git", "commit", "-q", "--allow-empty", "-m", "x"], cwd=place, check=True)


def kind_of_tag(place: Path) -> str:
    """Its text must be whole, too."""
    shown = subprocess.run(["git", "cat-file", "tag", "v1"], cwd=place, check=True, capture_output=True, text=True)
    assert NOTES in shown.stdout
    return "signed" if "-----BEGIN SSH SIGNATURE-----" in shown.stdout else "annotated"


@pytest.mark.needs("ssh-keygen")
def test_tag_and_checksums_are_signed_where_a_key_is_given(
    dist: Path, key: Path, repository: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    committed(repository)
    tag("v1", NOTES, repository)
    assert kind_of_tag(repository) == "signed"
    assert capsys.readouterr().out == "tagged v1, signed\n"
    sums = write_checksums(dist)
    for _ in range(2):  # the second signature replaces the first
        assert sign(sums) == "SHA256SUMS: signed, in SHA256SUMS.sig"
    (dist / "allowed").write_text(f"releases {key.with_suffix('.pub').read_text()}")
    words = ["ssh-keygen", "-Y", "verify", "-f", dist / "allowed", "-I", "releases", "-n", "file", "-s", f"{sums}.sig"]
    assert subprocess.run(words, input=sums.read_bytes(), capture_output=True, check=False).returncode == 0
    assert subprocess.run(words, input=b"other", capture_output=True, check=False).returncode != 0


def test_release_without_a_key_says_that_it_is_not_signed(
    dist: Path, repository: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    use_settings(monkeypatch, {})
    committed(repository)
    tag("v1", NOTES, repository)
    assert kind_of_tag(repository) == "annotated"
    assert (
        "tagged v1; not signed, for there is no key: set one with `git config user.signing" in capsys.readouterr().out
    )
    with pytest.raises(SystemExit, match=r"the tag v1 was not made: .*already exists"):
        tag("v1", "first\n", repository)
    assert "not signed" in sign(write_checksums(dist))
    assert not list(dist.glob("SHA256SUMS.*"))


@pytest.mark.needs("ssh-keygen")
def test_release_that_cannot_be_signed_ends(dist: Path, key: Path, repository: Path) -> None:
    key.unlink()
    committed(repository)
    with pytest.raises(SystemExit, match=r"the tag v1 was not (made|signed)"):
        tag("v1", NOTES, repository)
    assert not list((repository / ".git/refs/tags").iterdir())
    with pytest.raises(SystemExit, match="SHA256SUMS was not signed: ssh-keygen "):
        sign(write_checksums(dist))


def test_checksums_are_those_that_sha256sum_finds(dist: Path) -> None:
    write_checksums(dist)
    write_checksums(dist)  # the list does not name itself
    words = ["sha256sum", "--check", "--strict", "SHA256SUMS"]
    assert subprocess.run(words, cwd=dist, capture_output=True, check=False).returncode == 0
    (dist / WHEEL).write_text("damaged")
    assert subprocess.run(words, cwd=dist, capture_output=True, check=False).returncode == 1
