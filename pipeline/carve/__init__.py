"""Carving: a mesh of one's own, cut from a solid texture and written with baked maps."""
