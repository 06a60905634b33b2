"""Dendrochronology over arrays: dated series of ring widths, and the files that its programs exchange."""
