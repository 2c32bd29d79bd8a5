"""Pads whose magnets are unknown: AnySkin, ReSkin and eFlesh skins. A package of its own."""
