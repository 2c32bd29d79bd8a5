"""All samples of pads since the last step, and their wrench, as arrays of fixed size for a data set."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from fmfts_client import Client, Contact, ControlError, request
from fmfts_client.row import COLUMNS, row_of
from fmfts_client.wrench import Wrench, wrench_of
from numpy.typing import NDArray

from lerobot_camera_fmfts.touch import TouchLostError, anywhere_sd_m, filled, is_usable, why_lost

MOST = 16  # more messages than arrive in 40 ms at 220 Hz
PATIENCE_S = 1.0  # longer than other programs keep both cores of a small computer busy
WRENCH = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")  # one point of the type `wrench` of LeRobot's tactile interface


class Samples:
    """Samples of several pads of one daemon, for LeRobot's `features` and `add_frame`: both take what this gives.

    most: samples a step for which there is room. patience_s: a pad may give nothing usable for so long, on a busy
    computer; meanwhile `.mask` says that there is no sample, and the wrench is the last one, whose age `.age_s` tells.
    Each pad has, under `observation.tactile.<pad>`:

    - "": the newest wrench (1, 6); `.sd`: its deviations; `.age_s` (1, 1)
    - `.samples` (most, COLUMNS): the newest last; `.mask` (most,): whether there is a sample
    - `.stamps_ns` (most,): when each was taken (UTC)
    - `.left_out` (1,): how many more there were since the last step
    """

    def __init__(
        self,
        names: Sequence[str],
        endpoint: str | None = None,
        pad_size_m: float = 0.04,
        most: int = MOST,
        patience_s: float = PATIENCE_S,
    ) -> None:
        self.names = tuple(names)
        self.most = most
        self.patience_s = patience_s
        self._endpoint = endpoint
        self._anywhere_sd_m = anywhere_sd_m(pad_size_m)
        self._clients: dict[str, Client] = {}
        self._last: dict[str, Contact] = {}
        self._usable: dict[str, Contact] = {}
        self._heights_m: dict[str, float] = {}

    @property
    def features(self) -> dict[str, dict[str, Any]]:
        return {
            f"observation.tactile.{name}{part}": {"dtype": dtype, "shape": shape, "names": names}
            for name in self.names
            for part, dtype, shape, names in (
                ("", "float32", (1, len(WRENCH)), list(WRENCH)),
                (".sd", "float32", (1, len(WRENCH)), list(WRENCH)),
                (".age_s", "float32", (1, 1), ["age_s"]),  # LeRobot takes a flat float32 for a part of the state
                (".samples", "float32", (self.most, len(COLUMNS)), list(COLUMNS)),
                (".mask", "bool", (self.most,), None),
                (".stamps_ns", "int64", (self.most,), None),
                (".left_out", "int64", (1,), None),
            )
        }

    def connect(self) -> None:
        """Raises TouchLostError if a pad sends nothing, or the daemon does not say where its magnet is."""
        self._clients = {name: Client(name, self._endpoint) for name in self.names}
        try:
            pads = request("pads", endpoint=self._endpoint)["pads"]
            self._heights_m = {pad["pad"]: pad["rest_position_m"][2] for pad in pads}
            for name in self.names:
                self._since_the_last_step(name, self.patience_s)
        except ControlError as error:
            self.disconnect()
            raise TouchLostError(str(error)) from error
        except TouchLostError:
            self.disconnect()
            raise

    def disconnect(self) -> None:
        for client in self._clients.values():
            client.close()
        self._clients, self._last, self._usable = {}, {}, {}

    def frame(self) -> dict[str, NDArray[Any]]:
        """The samples of all pads since the last call, without waiting: a sample is never given out twice. Raises
        TouchLostError if a pad gave nothing usable for `patience_s`.
        """
        arrays: dict[str, NDArray[Any]] = {}
        for name in self.names:
            samples, left_out = self._since_the_last_step(name)
            for part, array in self._arrays(name, samples, left_out).items():
                arrays[f"observation.tactile.{name}{part}"] = array
        return arrays

    def _since_the_last_step(self, name: str, wait_s: float = 0.0) -> tuple[list[Contact], int]:
        """The samples for which there is room, and the number of further ones. wait_s: for a usable one."""
        client = self._clients.get(name)
        if client is None:
            raise TouchLostError(f"pad {name}: not connected")
        samples: list[Contact] = []
        until = time.monotonic() + wait_s
        last, left_out = self._last.get(name), 0
        while True:
            left_s = 0.0 if name in self._usable else max(0.0, until - time.monotonic())
            contact = next(client.contacts(left_s), None)
            if contact is None:
                break
            if last is not None and contact.boot == last.boot:
                left_out += contact.seq - last.seq - 1  # numbered, and never here
                if contact.t_sample_ns == last.t_sample_ns:
                    last = contact
                    continue  # the daemon repeats this message while the pad is silent
            samples.append(contact)
            last = contact
            if is_usable(contact):
                self._usable[name] = contact
        if last is not None:
            self._last[name] = last
        usable = self._usable.get(name)
        if usable is None or usable.sample_age_s > self.patience_s:
            raise TouchLostError(why_lost(client, samples[-1] if samples else None, self.patience_s))
        kept = samples[-self.most :]
        return kept, left_out + len(samples) - len(kept)

    def _arrays(self, name: str, samples: list[Contact], left_out: int) -> dict[str, NDArray[Any]]:
        rows = np.zeros((self.most, len(COLUMNS)), np.float32)
        stamps_ns, mask = np.zeros(self.most, np.int64), np.zeros(self.most, np.bool_)
        filled = slice(self.most - len(samples), None)
        if samples:
            rows[filled] = [row_of(contact, contact.sample_age_s) for contact in samples]
            stamps_ns[filled] = [contact.utc_ns - (contact.t_publish_ns - contact.t_sample_ns) for contact in samples]
            mask[filled] = True
        newest = self._wrench(self._usable[name])
        sd = np.sqrt(np.diag(newest.covariance))
        return {
            "": np.array([[*newest.force_n, *newest.torque_nm]], np.float32),
            ".sd": sd[None].astype(np.float32),
            ".age_s": np.array([[self._usable[name].sample_age_s]], np.float32),
            ".samples": rows,
            ".mask": mask,
            ".stamps_ns": stamps_ns,
            ".left_out": np.array([left_out], np.int64),
        }

    def _wrench(self, contact: Contact) -> Wrench:
        """Shear that is not known is 0; its deviation is that of any up to the normal force, a friction of 1."""
        known = filled(contact, self._anywhere_sd_m)
        any_shear_sd_n = (known.force_n or 0.0) / math.sqrt(3.0)
        return wrench_of(known, self._heights_m[contact.pad], 0.0, any_shear_sd_n)
