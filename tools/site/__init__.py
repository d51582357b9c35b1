"""The documentation site: what Sphinx needs beside `docs/conf.py`, and its check in a browser."""
