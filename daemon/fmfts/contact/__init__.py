"""Pose → contact: whether, where and how hard the pad is touched, and how uncertain all that is."""

from fmfts.contact.contract import ModelError
from fmfts.contact.estimate import ContactEstimate, doubt
from fmfts.contact.model import ContactModel
from fmfts.contact.smoothing import Smoother
from fmfts.contact.touch import TouchDetector

__all__ = ["ContactEstimate", "ContactModel", "ModelError", "Smoother", "TouchDetector", "doubt"]
