"""Modules in this process or served by it, and what becomes of bytes and cables on the way."""
