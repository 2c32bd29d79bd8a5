"""The Debian package on a plain Debian 12 under real systemd: boot, serve, refuse strangers, recover, upgrade, purge.

Run as root: `make drill-service`. Prints what it saw; ends with an error at the first deviation.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from drills.container import Container, debian_tree, wait_for  # noqa: E402

LATEST = """
import time
from fmfts_client import Client
with Client({pad!r}) as pad:
    end = time.monotonic() + {seconds}
    while time.monotonic() < end:
        contact = pad.latest(timeout_s=1.0)
        if contact is not None and (contact.health == {health!r} or {health!r} == "any"):
            print(contact.health, contact.sensors_ok, contact.contact, contact.reason)
            break
    else:
        print("nothing within {seconds} s")
"""
STRANGER = """
import zmq
socket = zmq.Context().socket(zmq.SUB)
socket.setsockopt(zmq.SUBSCRIBE, b"")
socket.connect("ipc:///run/fmfts/bus")
print("received" if socket.poll(3000) else "nothing in 3 s")
"""
BRIDGE = """
[[pad]]
name = "left"
[pad.source]
type = "bridge"
port = "/run/board/tty"
"""

MOST_EXPOSED = 1.5


def say(what: str, seen: object = "") -> None:
    print(f"{what}: {seen}" if seen != "" else what, flush=True)


def require(condition: object, what: str, seen: object = "") -> None:
    if not condition:
        raise AssertionError(f"{what}: {seen}")
    say(what, seen)


def contact(container: Container, pad: str = "demo", health: str = "ok", user: str = "controller") -> str:
    return container.python(LATEST.format(pad=pad, health=health, seconds=10.0), user)


def install(container: Container, package: Path) -> None:
    shutil.copy(package, container.root / "root/fmfts.deb")
    container.unbooted("apt-get", "update", "-qq")
    container.unbooted("apt-get", "install", "-y", "-qq", "--no-install-recommends", "/root/fmfts.deb")
    container.unbooted("useradd", "--create-home", "--groups", "fmfts", "controller")
    container.unbooted("useradd", "--create-home", "stranger")
    say("installed with apt", f"{len(installed_packages(container))} packages on the system")


def installed_packages(container: Container) -> list[str]:
    return container.unbooted("dpkg-query", "-W", "-f", "${Package}\n").split()


def drill_boot(container: Container) -> None:
    took_s = wait_for(lambda: container.property("ActiveState") == "active", "the service at boot")
    say("active after boot, without anybody's doing", f"{took_s:.1f} s after the rest of the system")
    wait_for(lambda: " Hz" in container.property("StatusText").replace(" 0 Hz", ""), "a rate in the status")
    say("systemctl status says", container.property("StatusText"))
    exposure = container.run("systemd-analyze security --no-pager fmfts | tail -1").strip("→ ")
    level = re.search(r": ([\d.]+) ", exposure)
    require(level is not None and float(level[1]) <= MOST_EXPOSED, "systemd-analyze security", exposure)
    unit = "/lib/systemd/system/fmfts.service"
    require(container.run(f"systemd-analyze verify --man=no {unit}") == "", "systemd-analyze verify prints", "nothing")
    complaints = container.run("journalctl -u fmfts -p 4 --no-pager -o cat") or "nothing"
    require("through Python" not in complaints, "journal at warning and above", complaints)


def drill_access(container: Container) -> None:
    require(contact(container).startswith("ok"), "a member of group fmfts reads", contact(container))
    refused = container.python(
        "import fmfts_client\ntry:\n fmfts_client.Client('demo')\nexcept Exception as e: print(e)", "stranger"
    )
    require("closed to you" in refused, "one who is no member is told", refused)
    require(container.python(STRANGER, "stranger") == "nothing in 3 s", "and gets from the socket", "nothing in 3 s")
    listing = container.run("ls -ld /run/fmfts /var/lib/fmfts /run/fmfts/* | cut -d' ' -f1,3,4,9-")
    require("srw-rw---- fmfts fmfts" in listing and "drwxr-x---" in listing, "modes", "\n" + listing)


def drill_recording(container: Container) -> None:
    """With only the packages that apt installed."""
    container.run("cd /home/controller && fmfts-daemon record a.mcap --seconds 3", user="controller")
    compared = json.loads(container.run("cd /home/controller && fmfts-daemon replay a.mcap --json", user="controller"))
    seen = {key: compared[key] for key in ("identical", "different")}
    require(seen["identical"] > 300 and not seen["different"], "recorded for 3 s and replayed", seen)


def drill_watchdog(container: Container) -> None:
    restarts = int(container.property("NRestarts"))
    pid = container.property("MainPID")
    start = time.monotonic()
    container.run(f"kill -STOP {pid}")
    wait_for(lambda: int(container.property("NRestarts")) > restarts, "a restart by the watchdog")
    require(contact(container).startswith("ok"), "SIGSTOP: contacts again", f"{time.monotonic() - start:.1f} s")
    require("watchdog" in container.run("journalctl -u fmfts --no-pager -o cat").lower(), "the watchdog was it", "yes")
    start = time.monotonic()
    container.run(f"kill -KILL {container.property('MainPID')}")
    wait_for(lambda: int(container.property("NRestarts")) > restarts + 1, "a restart after SIGKILL")
    require(contact(container).startswith("ok"), "SIGKILL: contacts again", f"{time.monotonic() - start:.1f} s")


def drill_wrong_config(container: Container) -> None:
    container.run("cp /etc/fmfts/config.toml /root/good.toml; head -c 2000 /dev/urandom > /etc/fmfts/config.toml")
    container.run("systemctl restart fmfts", check=False)
    wait_for(lambda: container.property("ActiveState") == "failed", "the failure")
    restarts = container.property("NRestarts")
    time.sleep(5.0)  # five times RestartSec
    state = {key: container.property(key) for key in ("ActiveState", "ExecMainStatus", "NRestarts")}
    require(
        state == {"ActiveState": "failed", "ExecMainStatus": "78", "NRestarts": restarts}, "garbage as config", state
    )
    say("the journal says", container.run("journalctl -u fmfts --no-pager -o cat -n 20 | grep fmfts-daemon | tail -1"))
    container.run("cp /root/good.toml /etc/fmfts/config.toml; systemctl restart fmfts")
    require(contact(container).startswith("ok"), "with the good one again", "serving")


def drill_board(container: Container) -> None:
    """A serial device through the whole sandbox: only the group dialout may open it, and it may be absent at first."""
    host = ROOT / "firmware/build/fmfts-host"
    shutil.copy(host, container.root / "usr/local/bin/fmfts-host")
    with (container.root / "etc/fmfts/config.toml").open("a") as config:
        config.write(BRIDGE)
    container.run("systemctl restart fmfts")
    seen = contact(container, "left", "disconnected")
    require(seen.startswith("disconnected"), "absent board: READY all the same", seen)
    time.sleep(8.0)  # longer than WatchdogSec
    require(container.property("NRestarts") != "" and container.property("ActiveState") == "active", "and no starving")
    container.run("mkdir -p /run/board && chmod 711 /run/board")
    board = "sleep infinity | /usr/local/bin/fmfts-host --link /run/board/tty"  # it ends with its input
    container.run(f"systemd-run --unit=board --quiet sh -c '{board}'")
    wait_for(lambda: container.run("readlink /run/board/tty", check=False), "the board's port")
    container.run("chown root:dialout $(readlink /run/board/tty) && chmod 660 $(readlink /run/board/tty)")
    seen = contact(container, "left", "no_baseline")
    require(seen.startswith("no_baseline 15"), "board plugged in", seen)
    status = container.property("StatusText")
    say("systemctl status says", status)


def drill_upgrade(container: Container, package: Path) -> None:
    container.run("systemctl stop board; cp /root/good.toml /etc/fmfts/config.toml")
    edits = (
        'name = .demo/name = "mine',
        'finger = .script/finger = "none',
        "turning_deg_per_s = 20/turning_deg_per_s = 0",
    )
    for edit in edits:
        container.run(f"sed -i 's/^{edit}/' /etc/fmfts/config.toml")
    container.run("systemctl restart fmfts")
    container.run("fmfts-daemon baseline --rest", user="controller")
    baselines = container.run("ls /var/lib/fmfts/baseline")
    newer = next_version(package, Path(tempfile.mkdtemp(dir=container.root / "root")))
    before = container.property("MainPID")
    container.run(f"dpkg --force-confdef --force-confold -i /{newer.relative_to(container.root)}")
    require(container.property("MainPID") not in (before, "0"), "upgrade restarts the service", "yes")
    seen = contact(container, "mine")
    require(seen.startswith("ok"), "upgraded, the edited configuration and its pad serve", seen)
    require(container.run("ls /var/lib/fmfts/baseline") == baselines, "baselines kept", baselines)


def next_version(package: Path, folder: Path) -> Path:
    tree = folder / "tree"
    subprocess.run(["dpkg-deb", "-R", package, tree], check=True)
    control = tree / "DEBIAN/control"
    control.write_text(re.sub(r"(?m)^Version: .*", r"\g<0>+next", control.read_text()))
    (tree / "etc/fmfts/config.toml").open("a").write("\n# Changed by the next version.\n")
    subprocess.run(["dpkg-deb", "-Zgzip", "-b", tree, folder / "next.deb"], check=True, stdout=subprocess.DEVNULL)
    return folder / "next.deb"


def drill_removal(container: Container) -> None:
    container.run("install -d -m 750 -o fmfts /etc/fmfts/keys && touch /etc/fmfts/keys/server.key")
    container.run("apt-get remove -y -qq fmfts")
    require(container.property("ActiveState") == "inactive", "removed: the service is", "inactive")
    kept = container.run("ls -d /etc/fmfts/config.toml /etc/fmfts/keys/server.key /var/lib/fmfts/baseline")
    require(kept.count("\n") == 2, "and left", kept.replace("\n", ", "))
    container.run("apt-get purge -y -qq fmfts")
    left = container.run("find / -xdev -iname '*fmfts*' -not -path '/proc/*' -not -path '/root/*' -not -path '/home/*'"
                         " -not -path '/usr/local/bin/fmfts-host'")  # fmt: skip
    require(left == "", "purged: files left", "none")


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("package", type=Path)
    options.add_argument("--cache", type=Path, default=ROOT / "build", help="where the tree of Debian is kept")
    arguments = options.parse_args()
    with Container(debian_tree(arguments.cache)) as container:
        install(container, arguments.package)
        container.boot()
        try:
            drill_boot(container)
            drill_access(container)
            drill_recording(container)
            drill_watchdog(container)
            drill_wrong_config(container)
            drill_board(container)
            drill_upgrade(container, arguments.package)
            drill_removal(container)
        except BaseException:
            say(container.run("systemctl status --no-pager -l -n 40 fmfts", check=False))
            raise
    print("all as it should be")


if __name__ == "__main__":
    main()
