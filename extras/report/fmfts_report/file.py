"""Writes and reads the file of a report: a recording, with the facts as a file of JSON beside its messages."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
from mcap.records import Channel, Message, Schema

from fmfts.common.reading import damage_told
from fmfts.view.facts import fact_lines
from fmfts_recording.file import KINDS, LARGEST_MESSAGE, CopyWriter, RecordingError, attachment, records
from fmfts_report.scrub import BINARY, Scrubber

NAME = "report.json"
LARGEST_FACTS = 1 << 22
MOST_TEXTS = 1000
# A stranger's file must not control the reader's terminal.
CONTROLS = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def write(writer: CopyWriter, recording: Path | None, facts: dict[str, Any], scrubber: Scrubber) -> None:
    """Write messages and facts, scrubbed, and end the file. Raises RecordingError."""
    kept: set[int] = set()
    for record in records(recording) if recording is not None else ():
        if isinstance(record, Channel) and record.topic.partition("/")[0] in KINDS:
            kept.add(record.id)
            writer.copy(record)
        elif isinstance(record, Schema):
            writer.copy(record)
        elif isinstance(record, Message) and record.channel_id in kept:
            record.data = _scrubbed(record.data, scrubber)
            writer.copy(record)
    writer.attach(NAME, msgspec.json.encode(scrubber.facts(facts)))
    writer.finish()


def _scrubbed(data: bytes, scrubber: Scrubber) -> bytes:
    """Most messages have nothing to scrub, and stay as they were to the last byte."""
    body = msgspec.json.decode(data)
    scrubbed = scrubber.message(body)
    return data if scrubbed == body else msgspec.json.encode(scrubbed)


def facts_of(path: Path) -> dict[str, Any]:
    """The facts of a report. Raises RecordingError where it has none, or they are damaged."""
    data = attachment(path, NAME)
    if data is None:
        raise RecordingError(f"{path} is a recording, and no report: `fmfts-daemon replay` reads it")
    if len(data) > LARGEST_FACTS:
        raise RecordingError(f"{path}: its facts have {len(data)} bytes: this program does not write as many")
    with damage_told(RecordingError, f"{path}: its facts are damaged"):
        return msgspec.json.decode(data, type=dict[str, Any])


def lines_of(path: Path) -> Iterator[str]:
    """The whole report as text: its facts, then the texts in its messages. Raises RecordingError."""
    for line in _lines(path):
        yield CONTROLS.sub("�", line)


def _lines(path: Path) -> Iterator[str]:
    facts = facts_of(path)
    with damage_told(RecordingError, f"{path}: its facts are not of this version"):
        texts = {key: value for key, value in facts.items() if key.startswith("log_")}
        texts |= {f"configuration: {facts['configuration'].pop('file', '')}": facts["configuration"].pop("text", "")}
        texts |= facts.pop("state")
        yield from fact_lines({key: value for key, value in facts.items() if key not in texts})
    for name, text in texts.items():
        yield ""
        yield f"--- {name}"
        yield from text.splitlines()
    yield ""
    yield "--- messages"
    yield from _told(path)


def _told(path: Path) -> Iterator[str]:
    """How many messages of each topic there are, and every text in them that is more than a word."""
    topics: dict[int, str] = {}
    counts: Counter[str] = Counter()
    texts: dict[str, None] = {}
    for record in records(path):
        if isinstance(record, Channel):
            topics[record.id] = record.topic
        elif isinstance(record, Message):
            counts[topics.get(record.channel_id, "?")] += 1
            if len(texts) < MOST_TEXTS and len(record.data) <= LARGEST_MESSAGE:
                with damage_told(RecordingError, f"{path}: a message is damaged"):
                    texts |= dict.fromkeys(_texts(msgspec.json.decode(record.data)))
    yield from (f"{topic}: {count}" for topic, count in sorted(counts.items()))
    yield from list(texts)[:MOST_TEXTS]


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str) and re.search(r"[/\s]", value):
        yield value
    elif isinstance(value, dict | list):
        for key, each in value.items() if isinstance(value, dict) else enumerate(value):
            if key != BINARY:
                yield from _texts(each)
