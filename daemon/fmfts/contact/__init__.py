"""Pose → contact: whether, where, how hard, and how sure that is."""

from fmfts.contact.contract import ModelError
from fmfts.contact.model import ContactEstimate, ContactModel, doubt
from fmfts.contact.smoothing import Smoother
from fmfts.contact.touch import TouchDetector

__all__ = ["ContactEstimate", "ContactModel", "ModelError", "Smoother", "TouchDetector", "doubt"]
