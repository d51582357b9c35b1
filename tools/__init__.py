"""Generators of documents and checksums."""
