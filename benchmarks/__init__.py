"""Programs that measure this package itself; not part of the wheel."""
