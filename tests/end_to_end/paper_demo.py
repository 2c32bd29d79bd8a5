"""`make demo PAPER=1`: the paper's readings through the firmware's own code, and what a subscriber receives."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from fmfts_simulation.demo import end_on_signals


def main() -> int:
    # Imported here, where Ctrl-C is waited for: it takes half a second.
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from end_to_end.paper import CONFIG, arrivals
    from end_to_end.processes import FirmwareHost, RunningDaemon

    end_on_signals()
    print("paper's Table 1 → emulated chips → firmware → pty → fmfts-daemon → ZeroMQ → here, beside Table 2\n")
    print("pose  Br (T)   position (mm)                 off (mm)   off (°)   remanence (T)", flush=True)
    with tempfile.TemporaryDirectory(prefix="fmfts-paper-") as name:
        folder = Path(name)
        with FirmwareHost(folder) as host, RunningDaemon(folder, CONFIG.format(port=host.port)) as daemon:
            arrived = []
            for arrival in arrivals(host, daemon):
                arrived.append(arrival)
                pose = arrival.contact.pose
                assert pose is not None
                x, y, z = (value * 1e3 for value in pose.position_m)
                print(
                    f"{arrival.reading.pose:>4}  {arrival.reading.remanence_t}   ({x:+.4f}, {y:+.4f}, {z:.4f})   "
                    f"{arrival.distance_m * 1e3:8.4f}  {arrival.angle_deg:8.3f}   "
                    f"{pose.remanence_t:.4f} ± {pose.remanence_sd_t:.4f}",
                    flush=True,
                )
    worst_mm = max(arrival.distance_m for arrival in arrived) * 1e3
    worst_deg = max(arrival.angle_deg for arrival in arrived)
    good = worst_mm < 0.02 and worst_deg < 0.15
    print(f"\nworst {worst_mm:.4f} mm, {worst_deg:.3f}° (limits 0.02 mm, 0.15°): {'passed' if good else 'FAILED'}")
    return 0 if good else 1


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except KeyboardInterrupt:
        raise SystemExit(130) from None
