"""A damaged key or list of keys gives one sentence, and an exit code after which systemd does not restart the
daemon."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from fmfts.bus.client_list import HEAD, LARGEST_LIST, ClosedKeysError, KeysError
from fmfts.bus.keys import KeyFolder
from fmfts.cli.main import main
from fmfts.common import exit_codes
from fmfts_client.keys import LARGEST_KEY_FILE, BadKeyError, client_key

CONFIG = '[bus]\nkeys = "keys"\n[[pad]]\nname = "left"\n[pad.source]\ntype = "simulated"\nfinger = "none"\n'
# It needs no file of the checkout, which may be closed to other users: no contact model and no package of simulations.
ON_A_BOARD = CONFIG.partition("type")[0] + 'type = "bridge"\nport = "/dev/ttyACM0"\n[pad.contact]\nmodel = "none"\n'
UNIT = Path(__file__).parents[2] / "systemd" / "fmfts.service"
NOBODY = 65534


@pytest.fixture
def keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A configuration with a folder of keys, for two clients."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("FMFTS_BUS", f"ipc://{tmp_path}")
    (tmp_path / "config.toml").write_text(CONFIG)
    folder = KeyFolder(tmp_path / "keys")
    for name in ("arm", "leg"):
        folder.add(name, tmp_path / f"{name}.key")
    return tmp_path / "keys"


def replaced(path: Path, make: Callable[[Path], object]) -> None:
    path.unlink()
    make(path)


def without_secret(path: Path) -> None:
    path.write_text(path.read_text().replace("secret", "sacred"))


def another_pair(path: Path) -> None:
    KeyFolder(path.parents[1] / "others").add("x", path.parents[1] / "x.key")
    other = (path.parents[1] / "others" / "server.key").read_text().splitlines()
    path.write_text("\n".join([path.read_text().splitlines()[0], other[1], ""]))


ANY_FILE: dict[str, Callable[[Path], object]] = {
    "absent": Path.unlink,
    "a folder": lambda path: replaced(path, Path.mkdir),
    "a pipe": lambda path: replaced(path, os.mkfifo),
    "a loop": lambda path: replaced(path, lambda path: path.symlink_to(path)),
    "null bytes": lambda path: path.write_bytes(b"\0" * 100),
    "not UTF-8": lambda path: path.write_bytes(b"\xff\xfe" + path.read_bytes()[:60]),
    "too long": lambda path: path.write_bytes(b"x" * (LARGEST_LIST + 1)),
}
A_KEY: dict[str, Callable[[Path], object]] = {
    "empty": lambda path: path.write_bytes(b""),
    "cut off": lambda path: path.write_bytes(path.read_bytes()[:70]),
    "without a secret": without_secret,
    "of two pairs": another_pair,
    "open to others": lambda path: path.chmod(0o644),
}
DAMAGES = [(name, how) for name in ("server.key", "clients") for how in ANY_FILE] + [
    ("server.key", how) for how in A_KEY
]


@pytest.mark.parametrize("verb", ["run", "check-config"])
@pytest.mark.parametrize(("name", "how"), DAMAGES)
def test_damaged_key_is_bad_configuration(
    keys: Path, name: str, how: str, verb: str, capfd: pytest.CaptureFixture[str]
) -> None:
    (ANY_FILE | A_KEY)[how](keys / name)
    assert main([verb, "--config", str(keys.parent / "config.toml")]) == exit_codes.CONFIG
    said = capfd.readouterr().err
    assert "Traceback" not in said
    (sentence,) = [
        line for line in said.splitlines() if line.startswith(f"fmfts-daemon {verb}: ")
    ]  # others belong to the log
    assert str(keys / name) in sentence


def test_systemd_does_not_restart_for_a_damaged_key() -> None:
    (line,) = [line for line in UNIT.read_text().splitlines() if line.startswith("RestartPreventExitStatus=")]
    assert str(exit_codes.CONFIG) in line.partition("=")[2].split()


@contextmanager
def closed(path: Path) -> Iterator[None]:
    """For this process `path` cannot be read."""
    path.chmod(0)
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(NOBODY)
    try:
        yield
    finally:
        os.seteuid(0)


def test_closed_key_is_reported_by_check_config(keys: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The user who edits the configuration may not be the service's."""
    with tempfile.TemporaryDirectory() as open_to_all:  # pytest closes its own to others
        Path(open_to_all).chmod(0o755)
        config = Path(open_to_all) / "config.toml"
        config.write_text(ON_A_BOARD.replace('"keys"', f'"{keys}"'))
        assert main(["check-config", "--config", str(config)]) == exit_codes.DONE  # imports private files
        with closed(keys / "server.key"):
            assert main(["check-config", "--config", str(config)]) == exit_codes.DONE
    assert "warning: the keys were not checked" in capsys.readouterr().err
    with closed(keys / "server.key"), pytest.raises(ClosedKeysError, match="closed to this user"):
        KeyFolder(keys).check()


def test_key_list_is_read_once_it_becomes_readable() -> None:
    with tempfile.TemporaryDirectory() as open_to_all:
        Path(open_to_all).chmod(0o755)
        folder = KeyFolder(Path(open_to_all) / "keys")
        folder.add("arm", Path(open_to_all) / "arm.key")
        folder.folder.chmod(0o755)
        (arm,) = folder.clients().values()
        with closed(folder.folder / "clients"), pytest.raises(ClosedKeysError, match="closed to this user"):
            folder.client_with(arm.public)
        (folder.folder / "clients").chmod(0o640)
        assert folder.client_with(arm.public) == arm


def test_mended_list_with_its_old_time_is_read_again(keys: Path) -> None:
    """Like `cp -p` from a copy."""
    folder, path = KeyFolder(keys), keys / "clients"
    good, before = path.read_bytes(), path.stat()
    (arm, *_) = folder.clients().values()
    path.write_bytes(b"not a key\n")
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    with pytest.raises(KeysError, match="line 1"):
        folder.client_with(arm.public)
    damaged_ns = path.stat().st_ctime_ns
    while path.stat().st_ctime_ns == damaged_ns:  # the system's clock of files has steps
        path.write_bytes(good)
        os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert folder.client_with(arm.public) == arm


def test_list_keeps_its_owner_and_mode_when_root_writes_it(keys: Path) -> None:
    path = keys / "clients"
    if os.geteuid() == 0:
        os.chown(path, NOBODY, NOBODY)
    path.chmod(0o600)
    before = path.stat()
    KeyFolder(keys).grant("arm", may_change=True)
    after = path.stat()
    assert after.st_ino != before.st_ino
    assert (after.st_uid, after.st_gid, after.st_mode) == (before.st_uid, before.st_gid, before.st_mode)


def test_new_keys_of_root_are_those_of_the_folders_owner(tmp_path: Path) -> None:
    if os.geteuid() != 0:
        pytest.skip("needs root")
    (tmp_path / "keys").mkdir(mode=0o750)
    os.chown(tmp_path / "keys", NOBODY, NOBODY)
    KeyFolder(tmp_path / "keys").add("arm", tmp_path / "arm.key")
    for name in ("server.key", "clients"):
        made = (tmp_path / "keys" / name).stat()
        assert (made.st_uid, made.st_gid) == (NOBODY, NOBODY)
    assert (tmp_path / "arm.key").stat().st_uid == 0, "root carries it to the client"


@pytest.mark.parametrize("how", [*ANY_FILE, *A_KEY])
def test_damaged_key_of_a_client_is_bad_configuration(
    keys: Path, how: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    key = keys.parent / "arm.key"
    (ANY_FILE | A_KEY)[how](key)
    monkeypatch.setenv("FMFTS_BUS", "tcp://192.0.2.1:5570")
    monkeypatch.setenv("FMFTS_KEY", str(key))
    assert main(["status"]) == exit_codes.CONFIG
    (sentence,) = capsys.readouterr().err.splitlines()
    assert str(key) in sentence


def damages(whole: bytes) -> Iterator[bytes]:
    """A bit of each byte flipped, each truncation, and more than a file may hold; `make fuzz-files` tries the
    others."""
    for at in range(len(whole)):
        yield whole[:at]
        yield whole[:at] + bytes([whole[at] ^ 1 << at % 8]) + whole[at + 1 :]
    yield whole + b"x" * LARGEST_LIST


def test_each_damage_to_a_byte_of_the_daemons_key_is_seen(keys: Path) -> None:
    folder, path = KeyFolder(keys), keys / "server.key"
    public, refused = folder.server().public, 0
    for content in damages(path.read_bytes()):
        path.write_bytes(content)
        try:
            assert folder.server().public == public  # a bit that X25519 ignores
        except KeysError:
            refused += 1
    assert refused > 150


def test_each_damage_to_a_byte_of_a_clients_key_is_seen(keys: Path) -> None:
    """Except the daemon's public key, of which the client has no other copy."""
    path, refused = keys.parent / "arm.key", 0
    key = client_key(path)
    assert key is not None
    for content in damages(path.read_bytes()):
        path.write_bytes(content)
        try:
            read = client_key(path)
            assert read is not None
            assert read.public == key.public
        except BadKeyError:
            refused += 1
    assert refused > 150
    assert len(path.read_bytes()) > LARGEST_KEY_FILE


def test_damage_to_a_byte_of_the_list_never_grants_a_right(keys: Path) -> None:
    folder, path = KeyFolder(keys), keys / "clients"
    right = {client.public: client.may_change for client in folder.clients().values()}
    refused = 0
    for content in damages(path.read_bytes()):
        path.write_bytes(content)
        try:
            assert not any(client.may_change for client in folder.clients().values())
        except KeysError:
            refused += 1
    assert not any(right.values())
    assert refused > 150


@pytest.mark.parametrize(
    "line",
    [
        "x foe", "0" * 40, "0" * 39 + "~ foe", "\x00" * 40 + " foe", "#" * 40 + " foe", "0" * 40 + " foe ",
        "0" * 40 + " foe may", "0" * 40 + " foe may-change read-only", "0" * 40 + " foe\tmay-change", "0" * 40 + " leg",
    ],
)  # fmt: skip
def test_damaged_list_is_named_with_its_line(keys: Path, line: str) -> None:
    with (keys / "clients").open("a") as file:
        file.write(line + "\n")
    with pytest.raises(KeysError, match="line 4"):
        KeyFolder(keys).clients()


def test_list_without_its_first_line_names_that_line(keys: Path) -> None:
    """An owner who removed its clients, line by line, would lock them out."""
    (keys / "clients").write_text((keys / "clients").read_text().removeprefix(f"{HEAD}\n"))
    with pytest.raises(KeysError, match=f"line 1: this line must stand before it: {HEAD}$"):
        KeyFolder(keys).clients()


def test_damaged_daemon_key_has_its_own_remedy(keys: Path) -> None:
    (keys / "server.key").write_bytes(b"")
    with pytest.raises(KeysError, match="no usable public, secret: take it from a copy, or delete it"):
        KeyFolder(keys).check()
    (keys / "server.key").chmod(0o644)
    with pytest.raises(KeysError, match=r"open to others \(mode 0644\): chmod 600 \S+$"):
        KeyFolder(keys).check()


def test_key_on_two_lines_is_refused(keys: Path) -> None:
    """Two lines could grant it two rights."""
    listed = (keys / "clients").read_text()
    (keys / "clients").write_text(listed + listed.splitlines()[1].replace(" arm read-only", " foe may-change") + "\n")
    with pytest.raises(KeysError, match="line 4: this name or key is on a line above"):
        KeyFolder(keys).clients()


def test_daemon_without_keys_is_told_how_to_make_them(tmp_path: Path) -> None:
    with pytest.raises(KeysError, match="keys new NAME"):
        KeyFolder(tmp_path / "keys").server()


def test_null_byte_in_the_name_of_the_folder_is_refused(keys: Path) -> None:
    config = keys.parent / "config.toml"
    config.write_text(CONFIG.replace('"keys"', '"ke\\u0000ys"'))
    assert main(["check-config", "--config", str(config)]) == exit_codes.CONFIG
