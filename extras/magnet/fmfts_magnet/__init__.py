"""Checks a board with one magnet in a person's hand: channels, turns, mirrors, signs and scales of the chips.

The person holds a magnet above the middle, then moves it to +x and to +y. `search.py` looks for the explanation of what
the chips read; `verdict.py` says whether it is the drawing's.
"""

from fmfts_magnet.readings import STEPS, Board, Hand, Readings, instructed_hand
from fmfts_magnet.verdict import TooLittleError, Verdict, judged, judged_by_name
from fmfts_magnet.words import sentences

__all__ = [
    "STEPS", "Board", "Hand", "Readings", "TooLittleError", "Verdict", "instructed_hand", "judged", "judged_by_name",
    "sentences",
]  # fmt: skip
