"""Three robots with keys on one page: which are there, which are lost and how soon, and that a wrong key receives
nothing."""

from __future__ import annotations

import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgpack
import pytest
from websockets.exceptions import ConnectionClosed

from end_to_end.processes import PATIENCE_S, START_PATIENCE_S
from end_to_end.robots import NAMES, OpenPage, Robots, are
from fmfts.bus.keys import KeyFolder
from fmfts_client import KEY_VARIABLE, Subscription
from page.rig import View

SOON_S = 0.5
SILENCE_S = 1.5  # thirty polls of the fleet, and a status of each pad


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robots]:
    robots = Robots(tmp_path_factory.mktemp("fleet"))
    yield robots
    robots.close()


@pytest.fixture(scope="module")
def view(robots: Robots) -> Iterator[View]:
    with robots.view(robots.keys) as view:
        yield view


@pytest.fixture
def fleet(robots: Robots, view: View) -> Iterator[OpenPage]:
    """An open page with all three robots."""
    for daemon in robots.daemons.values():
        if daemon.process.poll() is not None:
            daemon.start()
    with OpenPage(view) as page:
        page.until(are("there", *NAMES), START_PATIENCE_S)
        yield page


class Listener:
    """A client of one robot's pad, in a thread: the numbers of the contacts that it received."""

    def __init__(self, robots: Robots, name: str) -> None:
        self._over = threading.Event()
        self._messages = Subscription(("contact",), "left", robots.endpoints(name))
        self.numbers: list[int] = []
        self.boots: set[str] = set()
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def _listen(self) -> None:
        while not self._over.is_set():
            if (message := self._messages.receive(0.05)) is not None:
                self.numbers.append(message.body["seq"])
                self.boots.add(message.body["boot"])

    def wait(self, count: int) -> None:
        """Until this many more have come."""
        wanted, end = len(self.numbers) + count, time.monotonic() + PATIENCE_S
        while len(self.numbers) < wanted:
            assert time.monotonic() < end, len(self.numbers)
            time.sleep(0.01)

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        self._messages.close()


def test_three_robots_are_there_with_address_pads_rate_and_health(robots: Robots, fleet: OpenPage) -> None:
    told = fleet.until(  # a robot that a busy computer stops for half a second counts as lost until it goes on
        lambda told: (
            are("there", *NAMES)(told)
            and told["head"]["pads"] == 2
            and told["arm"]["health"] == {"ok": 1}
            and told["arm"]["rate_hz"]
        )
    )
    assert list(told) == list(NAMES)
    for name, robot in told.items():
        assert robot["address"] == robots.daemons[name].base
        assert robot["rate_nominal_hz"] == 220.0
        assert robot["why"] == ""
    assert told["arm"]["pads"] == 1
    assert told["arm"]["rate_hz"] > 0.0


def test_worst_pad_is_named_with_its_reason(fleet: OpenPage) -> None:
    head = fleet.until(lambda told: told["head"]["health"] == {"disconnected": 1, "ok": 1})["head"]
    assert head["pads"] == 2
    assert head["rate_hz"] == 0.0
    assert head["worst"]["pad"] == "right"
    assert "/dev/no-such-board" in head["worst"]["reason"]


@pytest.mark.real_time  # a client that reads too slowly for a second loses messages
def test_killed_robot_is_lost_and_the_others_go_on_without_a_gap(robots: Robots, fleet: OpenPage) -> None:
    listeners = [Listener(robots, name) for name in ("arm", "head")]
    try:
        for listener in listeners:
            listener.wait(20)
        robots.daemons["leg"].process.kill()
        told = fleet.until(lambda told: told["leg"]["state"] != "there")
        assert told["leg"]["state"] == "lost"
        assert told["leg"]["why"].startswith(f"no daemon at {robots.daemons['leg'].base}: is the robot on")
        assert (told["leg"]["pads"], told["leg"]["rate_hz"], told["leg"]["health"]) == (1, None, {})
        for listener in listeners:
            listener.wait(100)
        for _ in range(4):
            assert are("there", "arm", "head")(fleet.told())
    finally:
        for listener in listeners:
            listener.close()
    for listener in listeners:
        assert len(listener.boots) == 1
        first, last = listener.numbers[0], listener.numbers[-1]
        assert listener.numbers == list(range(first, last + 1))


def test_returning_robot_is_shown_again(robots: Robots, fleet: OpenPage) -> None:
    robots.daemons["leg"].process.kill()
    robots.daemons["leg"].process.wait()
    fleet.until(are("lost", "leg"))
    robots.daemons["leg"].start()
    told = fleet.until(are("there", "leg"), START_PATIENCE_S)
    assert told["leg"]["pads"] == 1


def test_stopped_robot_with_open_connections_is_lost_and_back(robots: Robots, fleet: OpenPage) -> None:
    """Like one whose network is cut: no connection is closed, and nothing arrives."""
    robots.daemons["arm"].process.send_signal(signal.SIGSTOP)
    try:
        fleet.until(are("lost", "arm"))
    finally:
        robots.daemons["arm"].process.send_signal(signal.SIGCONT)
    fleet.until(are("there", "arm"))


@pytest.mark.real_time
@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_lost_robot_is_reported_within_half_a_second(robots: Robots, fleet: OpenPage, how: signal.Signals) -> None:
    for name in NAMES:
        began_s = time.monotonic()
        robots.daemons[name].process.send_signal(how)
        try:
            fleet.until(are("lost", name))
            took_s = time.monotonic() - began_s
        finally:
            robots.daemons[name].process.send_signal(signal.SIGCONT)
        print(f"{name}, {how.name}: lost after {took_s:.3f} s")
        assert took_s < SOON_S


def hears_nothing(view: View, name: str) -> None:
    """A robot's own view receives no message, and its fleet's receives no pad."""
    with OpenPage(view, f"/robot/{name}/") as page:
        end = time.monotonic() + SILENCE_S
        while (left_s := end - time.monotonic()) > 0:
            try:
                assert isinstance(page.socket.recv(timeout=left_s), str), "a message of the bus"
            except TimeoutError:
                return


def wrong_key(robots: Robots, folder: Path, name: str, change: Callable[[Path], None]) -> Path:
    """A folder of keys in which one robot has another robot's key."""
    shutil.copytree(robots.keys, folder)
    change(folder / f"{name}.key")
    return folder


def test_unknown_key_receives_nothing_and_page_says_so(robots: Robots, fleet: OpenPage, tmp_path: Path) -> None:
    def forgotten(path: Path) -> None:
        path.unlink()
        KeyFolder(robots.folder / "leg" / "keys").add("gone", path)
        KeyFolder(robots.folder / "leg" / "keys").forget("gone")

    keys = wrong_key(robots, tmp_path / "keys", "leg", forgotten)
    with robots.view(keys) as view, OpenPage(view) as page:
        told = page.until(lambda told: told["leg"]["state"] == "unreached" and are("there", "arm", "head")(told))
        assert told["leg"]["why"] == (
            f"the daemon at {robots.daemons['leg'].base} refuses the key in {keys}/leg.key: `fmfts-daemon keys list` "
            "there shows those it knows"
        )
        assert told["leg"]["pads"] == 0
        hears_nothing(view, "leg")


def test_wrong_robot_key_receives_nothing_and_page_says_so(robots: Robots, fleet: OpenPage, tmp_path: Path) -> None:
    keys = wrong_key(robots, tmp_path / "keys", "leg", lambda path: shutil.copy(robots.keys / "arm.key", path))
    with robots.view(keys) as view, OpenPage(view) as page:
        told = page.until(lambda told: told["leg"]["state"] == "unreached" and are("there", "arm", "head")(told))
        assert told["leg"]["why"] == (
            f"the daemon at {robots.daemons['leg'].base} has other keys than {keys}/leg.key says, or none: get a new "
            "key from its machine"
        )
        hears_nothing(view, "leg")


def test_missing_key_receives_nothing_and_page_says_so(robots: Robots, fleet: OpenPage) -> None:
    with robots.view(None, ("leg",)) as view, OpenPage(view) as page:
        told = page.until(are("unreached", "leg"))
        assert "accepts only clients with a key" in told["leg"]["why"]
        hears_nothing(view, "leg")


def test_one_key_in_environment_serves_robots_that_share_list(robots: Robots, fleet: OpenPage) -> None:
    with robots.view(None, ("arm",), **{KEY_VARIABLE: str(robots.keys / "arm.key")}) as view, OpenPage(view) as page:
        page.until(are("there", "arm"))


def test_each_robot_has_its_own_view_with_its_own_messages(robots: Robots, view: View, fleet: OpenPage) -> None:
    boots = set()
    for name in NAMES:
        with OpenPage(view, f"/robot/{name}/") as page:
            pads = [pad["pad"] for pad in page.asked(ask="read", verb="pads")["done"]["pads"]]
            assert pads == (["left", "right"] if name == "head" else ["left"])
            page.socket.send('{"ask": "watch", "detail": "left"}')
            seen: set[str] = set()
            while not seen:
                batch = page.socket.recv(timeout=PATIENCE_S)
                if isinstance(batch, bytes):
                    unpacker = msgpack.Unpacker()
                    unpacker.feed(batch)
                    values = list(unpacker)
                    seen = {
                        body["boot"] for topic, body in zip(values[::2], values[1::2], strict=True) if "boot" in body
                    }
            assert len(seen) == 1
            boots |= seen
    assert len(boots) == 3


def test_recording_from_a_robots_view_uses_its_key_and_its_name(robots: Robots, view: View, fleet: OpenPage) -> None:
    with OpenPage(view, "/robot/head/") as page:
        name = page.asked(ask="record", on=True)["done"]["recording"]
        assert name.startswith("head-")
        path, end = robots.folder / name, time.monotonic() + START_PATIENCE_S
        while not path.exists() or path.stat().st_size < 10_000:  # the recorder was let in, and writes
            assert time.monotonic() < end, fleet.told()
            time.sleep(0.1)
        ended = page.asked(ask="record", on=False)
    assert "done" in ended, ended
    assert "left" in ended["done"]["pads"]


def test_page_of_the_fleet_only_shows(view: View, fleet: OpenPage) -> None:
    for ask in ({"ask": "baseline", "pad": "left", "kind": "bare"}, {"ask": "record", "on": True}):
        assert "only shows" in fleet.asked(**ask)["error"]


def test_fleet_page_without_token_receives_nothing(view: View, fleet: OpenPage) -> None:
    for place in ("/", "/robot/arm/"):
        with OpenPage(view, place, token="wrong") as page:
            with pytest.raises(ConnectionClosed) as closed:
                page.socket.recv(timeout=PATIENCE_S)
            assert closed.value.rcvd is not None
            assert closed.value.rcvd.code == 4401


def test_fleet_view_needs_little_processor_and_constant_memory(view: View, fleet: OpenPage) -> None:
    for _ in range(3):  # the robot may have just started
        before_s, before_kb = view.processor_s, view.resident_kb
        time.sleep(5.0)
        took_s, grew_kb = view.processor_s - before_s, view.resident_kb - before_kb
        if took_s < 0.25 * 5.0 and grew_kb < 2048:
            return
    raise AssertionError(f"it goes on taking {took_s:.2f} s of a processor and {grew_kb} kB more in five seconds")
