"""Exports: the wood in the formats of other programs, one module each (docs/export.md)."""
