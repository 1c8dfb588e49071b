"""Colours of what is made of metal, plastic and glass, whatever it belongs to."""

from shoot.world.looks.meshes import linear_rgb

STEEL = linear_rgb(92, 96, 98)
DARK = linear_rgb(30, 32, 32)
RED = linear_rgb(112, 14, 16)
WHITE = linear_rgb(225, 225, 215)
