"""Ten attacks of another user of the robot's computer: none gets in, and none keeps the owner out.

`make security` runs them all and prints a table; `make test` leaves out those that last long.
"""

from __future__ import annotations

import os
import socket
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import permitted
from end_to_end.processes import PATIENCE_S, UNTOUCHED_CONFIG, RunningDaemon, run_command
from fmfts_client.endpoints import EndpointError, for_daemon
from fmfts_collect.gauge import open_gauge
from fmfts_collect.settings import UdpGauge
from page.rig import View
from page.test_browser import opened_by_view
from ports import free_udp_port, tcp_base
from security.robot import Attack, DaemonByDefault, environment_of_nobody, open_folder, owner_opens

pytestmark = pytest.mark.skipif(not permitted.another_user(), reason="only root can act as another user")

Row = tuple[str, str, str]


@pytest.fixture(scope="module")
def table() -> Iterator[list[Row]]:
    rows: list[Row] = []
    yield rows
    print(f"\n\n{'attack':58}{'got in':10}owner")
    for attack, gained, owner in rows:
        print(f"{attack:58}{gained:10}{owner}")


@pytest.fixture(scope="module")
def robot() -> Iterator[tuple[DaemonByDefault, View]]:
    with (
        open_folder() as folder,
        DaemonByDefault(folder, UNTOUCHED_CONFIG) as daemon,
        opened_by_view(folder, daemon.environment) as (view, _),
    ):
        yield daemon, view


def unharmed(daemon: RunningDaemon, view: View, baseline: object) -> str:
    """The table's row about the owner, who must get in, and whose baseline must be unchanged."""
    took_s = owner_opens(view)
    assert daemon.request("pads")["pads"][0]["baseline"] == baseline
    return f"gets in, {took_s:.1f} s"


def test_page_and_sockets_let_no_other_user_in(robot: tuple[DaemonByDefault, View], table: list[Row]) -> None:
    daemon, view = robot
    baseline = daemon.request("pads")["pads"][0]["baseline"]
    for what, attack in (
        ("1 read the page's token from /proc", Attack("read_the_token", port=view.port)),
        ("2 use the page without the token", Attack("use_the_page_without_the_token", port=view.port)),
        ("4 come by another name (DNS rebinding, another page)", Attack("come_by_another_name", port=view.port)),
        ("5 use the daemon's sockets on ipc", Attack("use_the_sockets", folder=str(daemon.folder))),
    ):
        assert attack.gained() == []
        table.append((what, "no", unharmed(daemon, view, baseline)))


@pytest.mark.slow
@pytest.mark.parametrize("begins", ["", "GET /"], ids=["silence", "a request"])
def test_full_waiting_room_still_admits_the_owner(
    robot: tuple[DaemonByDefault, View], table: list[Row], begins: str
) -> None:
    daemon, view = robot
    baseline = daemon.request("pads")["pads"][0]["baseline"]
    attack = Attack("take_all_places", port=view.port, seconds=3 * PATIENCE_S, pages=True, begins=begins)
    attack.wait_until_ready()
    owner = unharmed(daemon, view, baseline)
    attack.end()
    table.append((f"3 take all places, each with {begins!r}", "no", owner))


def test_tcp_without_keys_takes_no_command(tmp_path: Path, table: list[Row]) -> None:
    with RunningDaemon(tmp_path, UNTOUCHED_CONFIG, endpoint=tcp_base()) as daemon:
        assert Attack("command_over_tcp", base=daemon.base).gained() == []
        table.append(("6 command a daemon on tcp without keys", "no", "is obeyed on ipc alone"))


@pytest.mark.slow
def test_keys_keep_strangers_and_readers_from_commands(table: list[Row], monkeypatch: pytest.MonkeyPatch) -> None:
    with open_folder() as folder:
        base = tcp_base()
        config = folder / "config.toml"
        keys, reader, owner = folder / "keys", folder / "reader.key", folder / "owner.key"
        config.write_text(UNTOUCHED_CONFIG + f'[bus]\nendpoint = "{base}"\nkeys = "{keys}"\n')
        for words in (("reader", "-o", str(reader)), ("owner", "-o", str(owner), "--may-change")):
            made = run_command("keys", "new", *words, "--config", str(config), environment=environment_of_nobody())
            assert made.returncode == 0, made.stderr
        stolen = folder / "stolen.key"
        stolen.write_bytes(reader.read_bytes())
        stolen.chmod(0o600)
        os.chown(stolen, 65534, 65534)
        monkeypatch.setenv("FMFTS_KEY", str(owner))
        with RunningDaemon(folder, UNTOUCHED_CONFIG, endpoint=base, keys=keys) as daemon:
            assert Attack("listen_without_a_key", base=base).gained() == []
            assert Attack("command_over_tcp", base=base, key=str(stolen)).gained() == []
            read = {Path(name).name for name in Attack("read_files", folder=str(folder)).gained()}
            assert read == {"config.toml", "daemon.log", "stolen.key"}, "the last is the attacker's own"
            assert daemon.request("pads")["pads"][0]["pad"] == "left"
        table.append(("7 listen on tcp without a key, command with a reader's", "no", "is let in by the key"))


@pytest.mark.parametrize("stays", [True, False], ids=["stays", "leaves"])
def test_forged_force_reaches_no_gauge(stays: bool, table: list[Row]) -> None:
    port = free_udp_port()
    gauge = open_gauge(UdpGauge(port=port), None)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as program:
        program.connect(("127.0.0.1", port))
        attack = Attack("forge_the_force", port=port, program=program.getsockname()[1], stays=stays)
        if stays:
            attack.wait_until_ready()
        else:
            assert attack.gained() == []
        assert gauge.poll(time.monotonic_ns()) == gauge.poll(time.monotonic_ns()) == []
        assert "another user" in gauge.unread
        gauge.close()
        attack.end()
    how = "and stay" if stays else "and leave"
    table.append((f"9 forge the force of collect over UDP, {how}", "no", "is told why it is not read"))


@pytest.mark.parametrize(
    ("mode", "named"),
    [
        (0o700, False),
        (0o777, False),
        (0o777, True),
        (0o755, True),
    ],
    ids=["closed", "open", "named and open", "named"],
)
def test_folder_of_another_user_is_no_endpoint(
    mode: int, named: bool, table: list[Row], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever owns the folder of the sockets could replace them. By default it is fmfts-<uid> in the one for all."""
    with open_folder() as folder:
        folder.chmod(0o1777)
        monkeypatch.setattr(tempfile, "tempdir", str(folder))
        occupied = folder / ("robot" if named else f"fmfts-{os.geteuid()}")
        assert Attack("occupy_the_folder", folder=str(occupied), mode=mode).gained() == []
        with pytest.raises(EndpointError, match=str(occupied)):
            for_daemon(f"ipc://{occupied}" if named else None, environ={})
        table.append((f"8 own the folder of the sockets, {mode:o}{', named' if named else ''}", "no", "is told"))


@pytest.mark.slow
def test_planted_links_redirect_no_file(table: list[Row]) -> None:
    """The owner writes a key and a recording to a folder that everybody may write to."""
    with open_folder() as folder, open_folder() as owners:
        folder.chmod(0o1777)
        victim = owners / "victim"
        victim.write_text("the owner's")
        config = owners / "config.toml"
        config.write_text(UNTOUCHED_CONFIG + f'[bus]\nendpoint = "{tcp_base()}"\nkeys = "{owners}/keys"\n')
        links = {
            "arm.key": str(victim),
            "leg.key": f"{owners}/new",
            "hand.key": "",
            "a.mcap": str(victim),
            "b.mcap": "",
        }
        assert Attack("plant_links", folder=str(folder), targets=links).gained() == []
        for name in ("arm", "leg", "hand"):
            words = ("keys", "new", name, "-o", str(folder / f"{name}.key"), "--config", str(config))
            assert run_command(*words, environment=environment_of_nobody()).returncode != 0
        for name in ("a.mcap", "b.mcap"):
            environment = environment_of_nobody() | {"FMFTS_BUS": f"ipc://{owners}"}
            assert run_command("record", str(folder / name), environment=environment).returncode != 0
        assert victim.read_text() == "the owner's"
        assert not (owners / "new").exists()
        assert (folder / "hand.key").read_bytes() == (folder / "b.mcap").read_bytes() == b""
        table.append(("10 plant links and files where the owner writes", "no", "is told"))
