"""Formulas of causes that nobody has written down yet: a typed grammar, and the effects that its terms are."""
