"""`probe` beside a running daemon: two users of one mux would read plausible wrong values, so it asks the daemon."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any

from drills.rig import calibrated, is_not_ok, longest_gap_s, none_wrong


def probed(folder: Path, times: int) -> dict[str, Any]:
    """Probe repeatedly; no contact may be lost or changed."""
    with calibrated(folder) as (daemon, board, ear), ThreadPoolExecutor(1) as hands:
        probing = hands.submit(lambda: [daemon.command("probe", "--config", daemon.config) for _ in range(times)])
        heard = []
        while not (probing.done() and board.judged_pressed):
            heard.append(ear.next())
    # On a busy computer the board may have been silent for a moment, which a probe reports, too.
    unanswered = [each.stderr for each in probing.result() if each.returncode and "connected: no" not in each.stdout]
    facts = {
        "probes": times,
        "unanswered": unanswered,
        "contacts": len(heard),
        "lost": sum(b.seq - a.seq - 1 for a, b in pairwise(heard)),
        "longest_gap_s": longest_gap_s(heard),
        "not_ok": sorted({f"{one.health}: {one.reason}" for one in heard if is_not_ok(one)}),
    }
    assert (facts["unanswered"], facts["lost"]) == ([], 0), facts
    return facts | none_wrong(ear, board)
