"""The solid texture in shading languages, and the tables that these read."""
