"""Pads with several magnets: from the field to the fingers that press. docs/several.md describes the method and its
accuracy."""
