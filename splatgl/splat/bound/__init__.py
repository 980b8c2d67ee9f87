"""How far a picture may be from the right one."""
