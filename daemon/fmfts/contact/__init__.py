"""Pose → contact: whether, where and how hard the pad is touched, and how uncertain all that is."""

from fmfts.contact.contract import ModelError, OtherPadError
from fmfts.contact.estimate import ContactEstimate
from fmfts.contact.model import ContactModel
from fmfts.contact.no_model import NoContactModel
from fmfts.contact.touch import TouchDetector

__all__ = [
    "ContactEstimate",
    "ContactModel",
    "ModelError",
    "NoContactModel",
    "OtherPadError",
    "TouchDetector",
]
