"""From `init` to contacts on an emulated kernel bus, with any chip on any adapter. `make first-uses` prints figures."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from end_to_end.kernel_bus import KernelBus, kernel_bus
from end_to_end.processes import RunningDaemon, run_command
from fmfts.common import exit_codes
from fmfts.config.file import load
from fmfts.sensor.chips import CHIPS, TESLA_PER_GAUSS
from fmfts_client import Contact
from fmfts_lab.bench.recorded import pressed_field
from fmfts_simulation.mounted import MountedPad

# The chips that Linux reads: with their addresses without a mux if four fit on a bus; the others are behind one.
ADDRESSES: dict[str, tuple[int, ...]] = {
    "hmc5983": (),
    "hmc5883l": (),
    "qmc5883l": (),
    "qmc5883p": (),
    "lis3mdl": (),
    "mmc5983ma": (),
    "mmc5603nj": (),
    "mlx90393": (0x0C, 0x0D, 0x0E, 0x0F),
}
ADAPTERS = ("bcm2835", "designware")
EARTH_T = np.array([2e-5, 0.0, -4e-5])
PRESS = (3e-3, -2e-3, 1.0)  # x and y in metres, force in newton
MEASURED_S = 3.0
# A transfer takes the emulated bus 0.2 ms or more, and a frame of four MMC5983MA needs 17: more would measure the
# computer.
MOST_HZ = 40


class FirstUse(NamedTuple):
    """The results. rate_hz: of the configuration; measured_hz: of the contacts."""

    init_hz: int
    rate_hz: int
    measured_hz: float
    selftest: str
    before: Contact
    pressed: Contact
    usual_sd_n: float  # of a press's force: a frame's own noise widens the deviation of one in twenty
    after: Contact

    def __str__(self) -> str:
        felt = self.pressed
        x_mm, y_mm = felt.x_m * 1e3, felt.y_m * 1e3
        return (
            f"init {self.init_hz} Hz, stated {self.rate_hz} Hz, measured {self.measured_hz:.1f} Hz; "
            f"contact {self.before.contact}, {felt.contact}, {self.after.contact}; "
            f"{felt.force_n:.2f} ± {felt.force_sd_n:.2f} N at ({x_mm:.2f}, {y_mm:.2f}) mm; {self.selftest}"
        )


def first_use(folder: Path, chip: str, adapter: str, most_hz: int = MOST_HZ) -> FirstUse:
    """The commands as a person types them. Raises AssertionError if one reports an error."""
    addresses = ADDRESSES[chip]
    file = folder / "pad.toml"
    with kernel_bus(chip, *addresses, adapter=adapter) as bus:
        environment = os.environ | {"FMFTS_BUS": f"ipc://{folder}", "XDG_STATE_HOME": str(folder / "state")}

        def said(*words: object, code: int = exit_codes.DONE) -> str:
            ended = run_command(*map(str, words), "--config", file, environment=environment)
            assert ended.returncode == code, f"{words}: {ended.stdout}{ended.stderr}"
            return ended.stdout + ended.stderr

        said("init", "--i2c", 7)
        init_hz = _settle(file, chip, most_hz)
        config = load(file)[0].pad[0]
        assert config.source.chip == chip
        built = MountedPad.exact(config.pad())
        noise_gauss = CHIPS[chip].noise_at_t(config.source.rate_hz, "free") / TESLA_PER_GAUSS

        def feel(field_t: np.ndarray) -> None:
            _feel(bus, field_t, noise_gauss, muxed=not addresses)

        feel(np.tile(EARTH_T, (4, 1)))
        said("check-config")
        probed = said("probe")
        assert "faults: none" in probed, probed
        has_selftest = CHIPS[chip].bias_strap is not None or CHIPS[chip].tested_on_i2c
        selftest = said("selftest", code=exit_codes.DONE if has_selftest else exit_codes.DATA)
        said("baseline", "--bare", "--duration-s", 2)
        feel(pressed_field(built, 0.0, 0.0, 0.0, ambient_t=EARTH_T))
        said("baseline", "--rest", "--duration-s", 2)
        with RunningDaemon(folder, file.read_text()) as daemon:
            before = daemon.wait_for(lambda contact: contact.health == "ok")
            measured_hz = _rate_hz(daemon)
            feel(pressed_field(built, *PRESS, ambient_t=EARTH_T))
            pressed = _settled(daemon)
            held = [daemon.wait_for(lambda contact: contact.health == "ok").force_sd_n for _ in range(20)]
            feel(pressed_field(built, 0.0, 0.0, 0.0, ambient_t=EARTH_T))
            after = _settled(daemon)
    result = "self-test passed" if has_selftest else selftest.strip().removeprefix("fmfts-daemon selftest: ")
    return FirstUse(init_hz, config.source.rate_hz, measured_hz, result, before, pressed, float(np.median(held)), after)


def _settle(file: Path, chip: str, most_hz: int) -> int:
    """Returns the rate that init wrote, and writes one that the emulation can keep. Two chips may have one identity."""
    lines = file.read_text().splitlines()
    at = {line.partition(" = ")[0]: number for number, line in enumerate(lines) if " = " in line and line[0] != "#"}
    written_hz = int(lines[at["rate_hz"]].split()[2])
    lines[at["chip"]] = f'chip = "{chip}"'
    lines[at["rate_hz"]] = f"rate_hz = {min(written_hz, most_hz, CHIPS[chip].free_rate_hz)}"
    file.write_text("\n".join(lines))
    return written_hz


def _feel(bus: KernelBus, field_t: np.ndarray, noise_gauss: float, *, muxed: bool) -> None:
    for number, field in enumerate(field_t / TESLA_PER_GAUSS):
        changes = {"field_gauss": field.tolist(), "noise_gauss": noise_gauss}
        assert bus.order(**{"chip": [0, number]} if muxed else {"direct": number}, set=changes) == "done"


def _settled(daemon: RunningDaemon) -> Contact:
    """A contact at least half a second from now: the chips' fields change one after another."""
    settled_ns = time.monotonic_ns() + 500_000_000
    return daemon.wait_for(lambda contact: contact.t_sample_ns > settled_ns and contact.health == "ok")


def _rate_hz(daemon: RunningDaemon) -> float:
    """Contacts a second, by the times of their samples."""
    times_ns = []
    with daemon.subscribe("contact") as messages:
        end_s = time.monotonic() + MEASURED_S
        while (left_s := end_s - time.monotonic()) > 0:
            if (message := messages.receive(left_s)) is not None:
                times_ns.append(Contact.from_message(message.body).t_sample_ns)
    return (len(times_ns) - 1) * 1e9 / (times_ns[-1] - times_ns[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--most-hz", type=int, default=MOST_HZ, help="lower rates than init's are kept by any computer")
    parser.add_argument("chip", nargs="*", choices=[*ADDRESSES, []], default=[])
    options = parser.parse_args()
    for chip in options.chip or ADDRESSES:
        for adapter in ADAPTERS:
            with tempfile.TemporaryDirectory(prefix="fmfts-i2c-") as name:
                print(f"{chip:10s} {adapter:10s} {first_use(Path(name), chip, adapter, options.most_hz)}", flush=True)


if __name__ == "__main__":
    main()
