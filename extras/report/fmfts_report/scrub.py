"""Removes names of the user and the computer, and possible secrets, from a report's text."""

from __future__ import annotations

import ipaddress
import os
import pwd
import re
import socket
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

FIRST_PERSON, LAST_PERSON = 1000, 59999  # user ids of people, by the policy of Debian
NOT_NAMES = frozenset({"", "root", "fmfts", "localhost", "nobody"})
USER, HOST, REMOVED = "<user>", "<host>", "<removed>"
BINARY = "memory"  # a state's base64, which may contain a name by chance
# The rest of a line after such a name may be a secret. A folder of keys (`keys = …`) is none. Counts
# are bounded, so that no text takes a time that grows with the square of its length.
SECRET_WORD = re.compile(
    r"(?i:secret|passw(?:or)?d|passphrase|psk|token|credential|authorization|api_?key|private_?key)"
)
SECRET = re.compile(rf"""(?m)({SECRET_WORD.pattern}[\w.-]{{0,40}}["']?[ \t]{{0,8}}[=:][ \t]{{0,8}})(\S.*)$""")
PRIVATE_KEY = re.compile(r"-----BEGIN [A-Z ]*PRIVATE KEY-----.*?(?:-----END [A-Z ]*PRIVATE KEY-----|\Z)", re.DOTALL)
LOGIN = re.compile(r"(?<=://)[^/\s@\"']+@")
HOME = re.compile(r"/(?:home|Users)/[^/\s\"':,;)]+")
ADDRESS = re.compile(r"\b(?!127\.|0\.0\.0\.0)(?:\d{1,3}\.){3}\d{1,3}\b")
# What may be an IPv6 address (RFC 4291, section 2.2), or a clock time: `_without_ipv6` decides.
MAYBE_IPV6 = re.compile(
    r"(?<![\w:.])(?:[0-9A-Fa-f]{0,4}:){2,7}(?:(?:\d{1,3}\.){3}\d{1,3}|[0-9A-Fa-f]{1,4}|(?<=::))(?!\w|:\w)"
)
# Also in the name that systemd gives to a USB network adapter (systemd.net-naming-scheme: enx, wlx).
HARDWARE_ADDRESS = re.compile(
    r"(?<![\w:-])[0-9A-Fa-f]{2}([:-])(?:[0-9A-Fa-f]{2}\1){4}[0-9A-Fa-f]{2}(?!\w|[:-]\w)|(?<=\b(?:enx|wlx))[0-9a-f]{12}\b"
)


class Scrubber:
    """users, hosts, homes: the words and folders to replace."""

    def __init__(self, users: Iterable[str], hosts: Iterable[str], homes: Iterable[str]) -> None:
        self._homes, self._users, self._hosts = map(_any_of, (homes, users, hosts))

    def text(self, text: str) -> str:
        for pattern, put in (
            (PRIVATE_KEY, REMOVED),
            (SECRET, rf"\1{REMOVED}"),
            (LOGIN, f"{USER}@"),
            (self._homes, "~"),
            (HOME, "~"),
            (self._users, USER),
            (self._hosts, HOST),
            (HARDWARE_ADDRESS, "<address>"),
            (MAYBE_IPV6, _without_ipv6),
            (ADDRESS, "<address>"),
        ):
            text = pattern.sub(put, text)
        return text

    def facts(self, value: Any) -> Any:
        """The same facts with scrubbed texts, also in keys that are paths; without values of keys like "password"."""
        if isinstance(value, str):
            return self.text(value)
        if isinstance(value, Mapping):
            return {
                self.text(str(key)) if "/" in str(key) else key: REMOVED if _is_secret(key) else self.facts(each)
                for key, each in value.items()
            }
        if isinstance(value, list | tuple):
            return [self.facts(each) for each in value]
        return value

    def message(self, value: Any) -> Any:
        """A message with its paths and sentences scrubbed. A single word stays: names of pads, and words of the schema,
        which a replay needs."""
        if isinstance(value, str):
            return self.text(value) if re.search(r"[/\s]", value) else value
        if isinstance(value, dict):
            return {
                key: REMOVED
                if _is_secret(key) and isinstance(each, str)
                else each
                if key == BINARY
                else self.message(each)
                for key, each in value.items()
            }
        if isinstance(value, list):
            return [self.message(each) for each in value]
        return value


def of_this_computer(environ: Mapping[str, str] = os.environ) -> Scrubber:
    """The names of this computer, of its people, and their home folders."""
    own = {os.getuid(), os.geteuid()}
    people = [each for each in pwd.getpwall() if each.pw_uid in own or FIRST_PERSON <= each.pw_uid <= LAST_PERSON]
    users = {environ.get(name, "") for name in ("USER", "LOGNAME", "SUDO_USER")}
    users |= {name for each in people for name in (each.pw_name, each.pw_gecos.partition(",")[0])}
    homes = {each.pw_dir for each in people} | {environ.get("HOME", "")}
    users |= {Path(home).name for home in homes if home.startswith("/home/")}
    host = socket.gethostname()
    return Scrubber(users - NOT_NAMES, {host, host.partition(".")[0]} - NOT_NAMES, homes - {"", "/"})


def _is_secret(key: Any) -> bool:
    """Whether a key names a secret. A path does not: it may hold the name of a pad."""
    return "/" not in str(key) and SECRET_WORD.search(str(key)) is not None


def _without_ipv6(found: re.Match[str]) -> str:
    try:
        address = ipaddress.IPv6Address(found[0])
    except ValueError:
        return found[0]
    return found[0] if address.is_loopback or address.is_unspecified else "<address>"


def _any_of(words: Iterable[str]) -> re.Pattern[str]:
    """Matches each of the words, unless a letter or digit is beside it."""
    longest_first = "|".join(map(re.escape, sorted(words, key=len, reverse=True)))
    return re.compile(rf"(?<![A-Za-z0-9])(?:{longest_first})(?![A-Za-z0-9])" if longest_first else r"(?!)")
