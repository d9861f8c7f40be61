"""Figures as SVG text, hand-written: small, sharp, readable without colour, and no plotting library on the station."""
