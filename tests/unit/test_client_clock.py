"""Clients on another machine, whose monotonic clock differs from the daemon's."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fmfts.bus.publisher import Publisher
from fmfts_client import Client, Endpoints
from fmfts_client.clock import DRIFT, SETTLING_S, SenderClock
from ports import tcp_base
from unit.bus_messages import contact_message

PATIENCE_S = 60.0
LATE = 7  # the number of a contact that comes late
# That machine was started an hour after this one, or before it.
AHEAD_S = [3600.0, -3600.0]
PERIOD_S = 0.02


@contextmanager
def far_daemon() -> Iterator[tuple[Publisher, Endpoints]]:
    endpoints = Endpoints.from_base(tcp_base())
    publisher = Publisher(endpoints, "one")
    try:
        yield publisher, endpoints
    finally:
        publisher.close()


def send(publisher: Publisher, ahead_s: float, waited_s: float = 0.0, **changes: Any) -> None:
    """A contact, sampled 5 ms before it was sent, by a daemon whose clock is `ahead_s` behind this machine's."""
    sent_ns = time.monotonic_ns() - int((ahead_s + waited_s) * 1e9)
    times = {"t_publish_ns": sent_ns, "t_sample_ns": sent_ns - 5_000_000, "boot": "one"}
    publisher.send_contact("demo", contact_message(**(times | changes)))


def settle(publisher: Publisher, client: Client, ahead_s: float, **changes: Any) -> float:
    """Send until the client hands something out; for how long it heard without doing so."""
    started_s, heard_s = time.monotonic(), None
    while True:
        send(publisher, ahead_s, **changes)
        asked_s = time.monotonic()
        newest = client.latest(timeout_s=PERIOD_S)
        if client.contact is not None and client.contact.boot == changes.get("boot", "one"):
            heard_s = heard_s or asked_s
        if newest is not None:
            return time.monotonic() - (heard_s or started_s)
        assert time.monotonic() - started_s < PATIENCE_S


@pytest.mark.parametrize("ahead_s", AHEAD_S)
def test_contacts_of_another_machine_are_handed_out_with_their_age(ahead_s: float) -> None:
    with far_daemon() as (publisher, endpoints), Client("demo", endpoints) as client:
        assert settle(publisher, client, ahead_s) >= SETTLING_S - PERIOD_S
        assert client.valid
        assert client.contact is not None
        assert 0.005 <= client.contact.sample_age_s < 0.3
        assert client.contact.clock_ahead_s == pytest.approx(ahead_s, abs=0.1)  # added by loopback and a busy machine


@pytest.mark.parametrize("ahead_s", AHEAD_S)
def test_delayed_contact_is_not_the_latest(ahead_s: float) -> None:
    with far_daemon() as (publisher, endpoints), Client("demo", endpoints) as client:
        settle(publisher, client, ahead_s)
        deadline_s = time.monotonic() + PATIENCE_S
        while client.contact is None or client.contact.seq != LATE:
            assert time.monotonic() < deadline_s
            send(publisher, ahead_s, waited_s=0.4, seq=LATE)
            newest = client.latest(timeout_s=0.2)
            assert newest is None or newest.seq != LATE  # one of `settle` may come now
        assert not client.alive


def test_old_sample_is_not_fresh() -> None:
    with far_daemon() as (publisher, endpoints), Client("demo", endpoints) as client:
        settle(publisher, client, 3600.0)
        deadline_s, newest = time.monotonic() + PATIENCE_S, None
        while newest is None or newest.seq != LATE:
            assert time.monotonic() < deadline_s
            send(publisher, 3600.0, t_sample_ns=time.monotonic_ns() - int(3600.4e9), seq=LATE)
            newest = client.latest(timeout_s=1.0)
        assert client.alive
        assert not client.fresh


def test_backlog_never_counts_as_new() -> None:
    """All that a daemon said before it died, read at once by a client that was busy."""
    with far_daemon() as (publisher, endpoints), Client("demo", endpoints) as client:
        deadline_s = time.monotonic() + PATIENCE_S
        while not client._subscription.wait(0.0):
            send(publisher, 3600.0)
            time.sleep(PERIOD_S)
            assert time.monotonic() < deadline_s
        for _ in range(20):
            send(publisher, 3600.0)
        time.sleep(0.5)
        assert client.latest(timeout_s=0.2) is None
        assert client.contact is not None
        assert not client.alive


def test_clock_of_a_restarted_machine_is_learned_anew() -> None:
    with far_daemon() as (publisher, endpoints), Client("demo", endpoints) as client:
        settle(publisher, client, 3600.0)
        assert settle(publisher, client, 90_000.0, boot="two") >= SETTLING_S - PERIOD_S
        assert client.restarts == 1
        assert client.valid


@given(
    st.floats(-1e6, 1e6),
    st.lists(st.tuples(st.floats(0.001, 2.0), st.floats(0.0, 5.0)), min_size=2, max_size=50),
    st.floats(-DRIFT, DRIFT),
)
def test_age_is_short_by_at_most_the_fastest_delay(
    ahead_s: float, arrivals: list[tuple[float, float]], drift: float
) -> None:
    """Whatever the delays: a message's age is too small by the fastest delay, and by the clocks' drift since then."""
    clock, now_s = SenderClock(), 1e5
    started_s, fastest = now_s, []
    for pause_s, delay_s in arrivals:
        now_s += pause_s
        sent_s = now_s - delay_s - ahead_s - drift * (now_s - delay_s - started_s)
        clock.take("one", sent_s, now_s)
        fastest.append((delay_s, now_s))
    if clock.ahead_s is None:
        assert now_s - started_s - arrivals[0][0] < SETTLING_S + 1e-9
        return
    told_s = now_s - clock.ahead_s - sent_s
    rounding_s = 1e-8  # rounding of times up to 1e6 s in double precision
    assert -rounding_s <= told_s <= delay_s * (1.0 + DRIFT) + rounding_s
    allowed_s = min(least_s + 2.1 * DRIFT * (now_s - then_s + least_s) for least_s, then_s in fastest)
    assert told_s >= delay_s * (1.0 - DRIFT) - allowed_s - rounding_s
