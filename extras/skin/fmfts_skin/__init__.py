"""AnySkin, ReSkin and eFlesh boards, and pads whose magnets are unknown. A package of its own."""

import fmfts.config  # noqa: F401 comes first, because it imports settings.py
