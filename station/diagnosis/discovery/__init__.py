"""Where no cause of the library fits: a formula of a typed grammar, and whether these data bear it."""
