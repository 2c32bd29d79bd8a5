"""Guards the page's server: accepted names and origins, the token, and the addresses to bind to."""

from __future__ import annotations

import ipaddress
import secrets
import socket
import ssl
import stat
from dataclasses import dataclass, field
from pathlib import Path

from fmfts_client.keys import FORBIDDEN_MODE

TOKEN_BYTES = 24


class RefusedAddressError(Exception):
    """These settings of the page's server are refused; the text says why, and what to do."""


@dataclass(frozen=True)
class Guard:
    """host: where the server is bound. certificate, key: files of TLS, needed off this machine."""

    host: str
    certificate: Path | None = None
    key: Path | None = None
    token: str = field(default_factory=lambda: secrets.token_urlsafe(TOKEN_BYTES), repr=False)

    def __post_init__(self) -> None:
        if (self.certificate is None) != (self.key is None):
            raise RefusedAddressError("TLS needs both: --certificate FILE and --key FILE")
        if self.key is None and not self.is_loopback:
            raise RefusedAddressError(
                f"{self.host} is not on this machine alone: whoever reads the line would read the token and could "
                "replace a baseline. Give --certificate FILE and --key FILE (TLS), or leave --host out and use "
                "`ssh -L 8710:127.0.0.1:8710` from the other machine"
            )

    @property
    def is_loopback(self) -> bool:
        try:
            return self.host == "localhost" or ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def scheme(self) -> str:
        return "http" if self.certificate is None else "https"

    def tls(self) -> ssl.SSLContext | None:
        """The TLS context, None without a certificate. RefusedAddressError if its files cannot be used."""
        if self.certificate is None or self.key is None:
            return None
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_2
        try:
            mode = stat.S_IMODE(self.key.stat().st_mode)
            if mode & FORBIDDEN_MODE:
                raise RefusedAddressError(f"{self.key} is open to others (mode {mode:04o}): chmod 600 {self.key}")
            context.load_cert_chain(self.certificate, self.key)
        except (OSError, ssl.SSLError) as error:
            raise RefusedAddressError(
                f"{self.certificate} and {self.key} are no certificate and its key: {error}"
            ) from error
        return context

    def hosts(self, port: int) -> frozenset[str]:
        """Accepted names of this server. They exclude a page of another name that a DNS trick led here."""
        names = {"localhost", "127.0.0.1", "[::1]"}
        if not self.is_loopback:
            names = {socket.gethostname(), socket.getfqdn(), *_own_addresses(self.host)}
        return frozenset(f"{name}:{port}".lower() for name in names)

    def origins(self, port: int) -> list[str]:
        """The pages that may open a connection: our own."""
        return [f"{self.scheme}://{host}" for host in sorted(self.hosts(port))]

    def address(self, port: int) -> str:
        """The address for a person. The token follows #, so it is neither sent to a server nor logged."""
        name = "127.0.0.1" if self.is_loopback else socket.getfqdn() if _is_any(self.host) else self.host
        return f"{self.scheme}://{f'[{name}]' if ':' in name else name}:{port}/#{self.token}"

    def knows(self, token: object) -> bool:
        return isinstance(token, str) and secrets.compare_digest(token.encode(), self.token.encode())


def _is_any(host: str) -> bool:
    return host in ("0.0.0.0", "::")


def _own_addresses(host: str) -> set[str]:
    """The names for one address; for all of them, the addresses that this machine's name has."""
    if not _is_any(host):
        return {f"[{host}]" if ":" in host else host}
    try:
        found = {str(entry[4][0]) for entry in socket.getaddrinfo(socket.gethostname(), None)}
    except OSError:
        found = set()
    return {f"[{each}]" if ":" in each else each for each in found}
