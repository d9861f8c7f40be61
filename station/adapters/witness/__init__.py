"""Both ends of a witness: the file of heads that it keeps, and the client by which a station reaches one."""
