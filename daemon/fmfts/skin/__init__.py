"""Contacts on a pad whose magnets are unknown: an AnySkin, ReSkin or eFlesh skin."""
