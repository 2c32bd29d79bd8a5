"""Pads with several magnets: from the field to the fingers that press. docs/several.md tells how, and how well."""
