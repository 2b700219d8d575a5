"""How far an estimated trajectory is from a true one."""
