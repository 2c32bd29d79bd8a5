"""Pose → contact: where the finger is, how hard it presses, and whether it is there at all."""

from fmfts.contact.contract import ModelError
from fmfts.contact.model import ContactEstimate, ContactModel
from fmfts.contact.touch import TouchDetector

__all__ = ["ContactEstimate", "ContactModel", "ModelError", "TouchDetector"]
