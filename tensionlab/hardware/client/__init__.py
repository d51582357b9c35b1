"""Clients of modules: links, locks, connections, groups, discovery, emergency stop."""
