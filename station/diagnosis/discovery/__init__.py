"""Formulas of a typed grammar for what no cause of the library explains, and the tests that accept or reject them."""
